"""Makes the clouds and the picture that are published, from a frame of the cable."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Unpack

import jax
import numpy as np
from jaxtyping import Num, UInt8

from jradar.errors import UsageError
from jradar.model import Model
from jradar.options.drawing import Drawing, given
from jradar.outputs.published import (
    LIDAR_FRAME,
    Published,
    lidar_cloud,
    odom_from_base,
    range_azimuth,
    sensor_places,
)
from jradar.pipeline import Pipeline, Stages
from jradar.pipeline.stages import Measured
from jradar.pipeline.together import MOST_POINTS
from jradar.radar import PointSpec
from jradar.recordings import Recording, Stream, nearest_scan
from jradar.recordings.ti import lanes
from jradar.recordings.ti.dca1000 import bytes_of_frame, described_samples
from jradar.recordings.ti.iq_order import cube_of_words
from jradar.types import SIZES, PointCloud

LEAST = "least_confidence"  # the option of drawing that every model takes
TOGETHER = [size for size in SIZES if size <= MOST_POINTS]  # of several frames
ROWS: Any = np.ones((1, 3), np.float32), np.ones(1, bool)
COLUMN: Any = np.ones(1, np.float32)
USUAL = PointCloud(*ROWS, velocity=COLUMN, snr=COLUMN)


def radar_on_the_cable(
    description: Path | str, *, device: str | None = None, iq_order: str | None = None
) -> Recording:
    """Return a recording without frames, which describes a radar on the cable.

    `description` is its .cfg or another description, and `device` the board of a .cfg.
    `iq_order` replaces the described order of I and Q. Errors as in `open_recording`.
    """
    path = Path(description)
    described = described_samples(path, path, iq_order=iq_order, device=device)
    radar, capture, notes = described
    return Recording(
        name=path.stem,
        path=path,
        radar=capture.radar(radar),
        cubes=Stream([].__getitem__, 0),
        base_from_radar=capture.base_from_radar(),
        iq_order=capture.iq_order,
        notes=(*notes, *lanes.warnings(radar, capture)),
    )


def frame_bytes(recording: Recording) -> int:
    """Return the bytes of a frame on the cable: 16 bits for each I and Q."""
    return bytes_of_frame(recording.radar.spec)


class Processor:
    """Makes clouds of one radar's frames, all of them drawn from the same noise."""

    def __init__(
        self,
        recording: Recording,
        *,
        model: Model | None = None,
        points: PointSpec | None = None,
        fuse: int = 1,
        history_s: float = 0.0,
        seed: int = 0,
        anyway: bool = False,
        **drawing: Unpack[Drawing],
    ):
        """`recording` describes the radar and its calibration.

        The radar's points are published, and with a model its dense cloud. Points that
        the radar does not send itself are found by `points`, or as the model's are. Of
        a recording with frames, which is played, each frame's LiDAR scan is published,
        too. The other options are those of `Pipeline`.
        """
        self.recording, self.pipeline = recording, None
        if model is None:
            key = jax.random.key(seed)
            radar = None if recording.of_points else recording.radar
            self._stages = Stages(key, radar, None, points=points)
        else:
            options = {"seed": seed, "fuse": fuse, "anyway": anyway, **drawing}
            options |= {"points": points, "history_s": history_s}
            self.pipeline = Pipeline(recording, model, **options)
        self._base_from = sensor_places(recording)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the radar and the frames so far."""
        return () if self.pipeline is None else tuple(self.pipeline.warnings)

    def cube(
        self, data: UInt8[np.ndarray, " byte"]
    ) -> Num[np.ndarray, "tx rx chirp sample"]:
        """Return the samples of a frame from its bytes on the cable."""
        radar, order = self.recording.radar.spec, self.recording.iq_order
        order = order or ("I" if radar.real_samples else "IIQQ")
        return cube_of_words(data.view("<i2"), radar, order)

    def measured(self, data: Any) -> Measured:
        """Return what the radar measured in a frame, from a `ReceivedFrame`'s data."""
        return data if self.recording.of_points else self.cube(data)

    def warm_up(self) -> None:
        """Run frames through everything, one of each size that is to be compiled.

        Points that are still to come are taken to have velocities and SNRs.
        """
        if self.recording.of_points:
            frames = self._first_points()
        else:
            zeros = np.zeros(frame_bytes(self.recording), np.uint8)
            frames = [self.cube(zeros)]
        for measured in frames:
            self.published(measured, 0, 0.0)
        if self.pipeline is not None:
            self.pipeline.reset()

    def _first_points(self) -> Iterator[PointCloud]:
        """Yield a cloud like the first, or as large as several frames together."""
        first = next(iter(self.recording.frames), USUAL)
        together = self.pipeline is not None and self.pipeline.history_s > 0
        for size in TOGETHER if together else [len(first.valid)]:
            yield jax.tree.map(
                lambda c, n=size: np.ones((n, *c.shape[1:]), c.dtype), first
            )

    def published(
        self,
        measured: Measured,
        number: int,
        stamp_s: float,
    ) -> Published:
        """Return the clouds of a frame, and the picture of samples.

        `measured` holds the samples, or the points of a radar that sends these. Frames
        of a recording that is played move as they did when they were recorded.
        """
        count, stamps = len(self.recording.frames), self.recording.frames.stamps
        index = number % count if count else None  # of a replay
        moved_s = stamp_s
        if index is not None and stamps is not None:
            moved_s = float(stamps[index])
        verdict = ()
        if self.pipeline is None:
            frame = self._stages.observe(measured)
            clouds = {"radar": frame.points}
        else:
            frame = self.pipeline.frame(number, measured, moved_s)
            clouds = {"radar": frame.points, "enhanced": frame.cloud}
            verdict = frame.verdict
        picture = moved = None
        if frame.samples is not None:
            picture = range_azimuth(frame.samples, self.recording.radar.spec)
        clouds, picture = jax.device_get((clouds, picture))
        if index is not None:
            moved = odom_from_base(self.recording, index)
            if (scan := nearest_scan(self.recording, index)) is not None:
                clouds[LIDAR_FRAME] = lidar_cloud(scan)
        places = self._base_from, moved
        return Published(number, stamp_s, clouds, picture, *places, verdict)


def quickest(model: Model | None, **drawing: Unpack[Drawing]) -> Drawing:
    """Return the options of drawing for a live model: by default one step of one draw.

    Raises UsageError for options that the model does not take.
    """
    asked = given(drawing)
    if model is not None and model.spec.method == "diffusion":
        sampling = asked.keys() & {"draws", "steps"}
        return Drawing(**({} if sampling else {"draws": 1, "steps": 1}), **asked)
    if unknown := [name for name in asked if model is None or name != LEAST]:
        raise UsageError(
            f"{', '.join(unknown)}: only a diffusion model draws samples, so leave "
            "these options out"
        )
    return Drawing(**asked)
