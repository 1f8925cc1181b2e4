"""The files of frames: clouds, arrays and pictures, as `jradar enhance` writes them.

DIR/radar.ply  enhanced.ply  enhanced.npz  capture.png             one frame
DIR/000012/radar.ply ..                                            several
DIR/radar/000012.ply ..  DIR/enhanced/000012.ply ..                several, flat
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar.errors import UsageError
from jradar.model import Model
from jradar.outputs.clouds import (
    CLOUD_WRITERS,
    valid_points,
    verdict_array,
    write_npz,
)
from jradar.outputs.guard import GuardedFolder
from jradar.pipeline import Detected, Frame, programs
from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    azimuth_map,
    point_deviations,
    range_doppler,
)
from jradar.range_image import ImageSpec
from jradar.recordings import Recording, nearest_scan
from jradar.types import PointCloud

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # which takes half a second to load

PICTURE = "capture.png"
PIXELS = 64  # on a side of the image of radar points


class FrameFolder:
    """A folder of frames: where the files of each lie, and which are written.

    The last of the `clouds` is also written as NPZ. A `flat` folder holds clouds alone,
    for tools that read all files of a folder.
    """

    def __init__(
        self,
        folder: GuardedFolder,
        clouds: Sequence[str],
        frames: range,
        *,
        kind: str = "ply",
        several: bool = False,
        flat: bool = False,
        pictured: bool = False,
        radar: RadarSpec | None = None,
    ):
        """Raise UsageError if files of these frames must not be replaced.

        A picture of each frame is written if it is `pictured`, and the folder is not
        flat. The `radar` is that of frames with samples.
        """
        self._folder, self._clouds, self._kind = folder, clouds, kind
        self._several, self._flat = several, flat
        self._pictured = pictured and not flat
        folder.check(name for frame in frames for name in self._names(frame))
        for part in (folder.path / name for name in clouds if flat):
            if part.is_dir() and any(part.iterdir()) and not folder.force:
                raise UsageError(
                    f"{part} is not empty, and tools read all clouds in a folder: "
                    "name another output, or add --force"
                )
        if self._pictured and radar is not None:  # while the first frame is computed
            thread = ThreadPoolExecutor(1)
            self._azimuths = thread.submit(_azimuth_program, radar)
            thread.shutdown(wait=False)

    def write_detected(
        self,
        frame: Detected,
        recording: Recording,
        *,
        deviations: PointSpec | None = None,
    ) -> list[str]:
        """Write the radar points of a frame; return the paths.

        With `deviations`, the options of the detector, the standard deviation of each
        coordinate is written, too.
        """
        radar, arrays = recording.radar, {}
        if deviations is not None:
            spec, valid = deviations.subtracting(radar.leakage), frame.points.valid
            found = point_deviations(frame.points, radar.spec, points=spec)
            named = found._asdict().items()
            arrays = {f"deviation_{name}": values[valid] for name, values in named}
        view = ImageSpec(PIXELS, PIXELS, max_range_m=radar.spec.max_range_m)
        figure = functools.partial(self._figure, frame, recording, view)
        return self._write(frame.number, (frame.points,), arrays, figure)

    def write_enhanced(
        self, frame: Frame, recording: Recording, model: Model
    ) -> list[str]:
        """Write the clouds of a frame, and its images; return the paths."""
        grid = model.spec.frame_grid
        arrays = grid.pictured(frame.image, frame.pixels)
        arrays = arrays | verdict_array(frame.verdict)
        shown = {name: arrays.get(name) for name in ("range_image", "polar_image")}
        figure = functools.partial(
            self._figure,
            frame,
            recording,
            grid.view,
            dense=frame.cloud,
            more=f"\nmodel: {model.card.purpose}",
            verdict="; ".join(frame.verdict),
            **shown,
        )
        clouds = frame.points, frame.cloud
        return self._write(frame.number, clouds, arrays, figure, frame.verdict)

    def _names(self, frame: int) -> list[str]:
        """Return the names of a frame's clouds, then of its arrays and picture."""
        if self._flat:
            return [f"{name}/{frame:06d}.{self._kind}" for name in self._clouds]
        names = [f"{name}.{self._kind}" for name in self._clouds]
        names += [f"{self._clouds[-1]}.npz", *([PICTURE] if self._pictured else [])]
        return [f"{frame:06d}/{name}" if self._several else name for name in names]

    def _write(
        self,
        frame: int,
        clouds: tuple[PointCloud, ...],
        arrays: dict[str, Any],
        figure: "Callable[[], Figure]",
        verdict: tuple[str, ...] = (),
    ) -> list[str]:
        def cloud_writer(cloud: PointCloud) -> Callable[[Path], None]:
            notes = verdict if cloud is clouds[-1] else ()
            return lambda path: CLOUD_WRITERS[self._kind](path, cloud, notes)

        writers: list[Callable[[Path], None]] = [
            *map(cloud_writer, clouds),
            lambda path: write_npz(path, valid_points(clouds[-1]) | arrays),
            lambda path: _viz().save_figure(figure(), path),
        ]
        files = dict(zip(self._names(frame), writers, strict=False))
        return self._folder.put(files, keep=self._flat)

    def _figure(
        self,
        frame: Detected | Frame,
        recording: Recording,
        view: ImageSpec,
        *,
        dense: PointCloud | None = None,
        range_image: np.ndarray | None = None,
        polar_image: np.ndarray | None = None,
        more: str = "",
        verdict: str = "",
    ) -> "Figure":
        """Draw the maps and the clouds, with the LiDAR's if there is one."""
        radar, maps, points = recording.radar, None, frame.points
        if frame.samples is not None:
            angles = self._azimuths.result()(frame.samples)
            maps = _viz().CaptureMaps(frame.power, angles, radar.spec)
            if isinstance(frame, Frame):
                points = detections(frame, radar)
        return _viz().capture_figure(
            points,
            view,
            maps=maps,
            dense=dense,
            metres=range_image,
            polar=polar_image,
            lidar=nearest_scan(recording, frame.number),
            title=f"{recording.name}, frame {frame.number}{more}",
            verdict=verdict,
        )


def detections(frame: Frame, radar: Radar) -> PointCloud:
    """Return the radar points of a frame whose cells are detections.

    A model takes weaker ones too, and those of earlier frames.
    """
    spec, cells, points = radar.spec, np.asarray(frame.detected), frame.points
    distance = np.linalg.norm(points.xyz, axis=1) + radar.range_bias_m
    column = np.rint(distance / spec.range_resolution_m).astype(int)
    row = np.rint(np.asarray(points.velocity) / spec.velocity_resolution_mps)
    row = (row.astype(int) + spec.num_chirps // 2) % spec.num_chirps
    seen = cells[row, np.minimum(column, cells.shape[1] - 1)]
    if points.age is not None:
        seen = seen & (np.asarray(points.age) == 0)
    return points._replace(valid=np.asarray(points.valid) & seen)


def _azimuth_program(radar: RadarSpec) -> Callable[..., Any]:
    """Return `azimuth_map` of a frame's samples, compiled, and load matplotlib."""

    def azimuths(samples):
        return azimuth_map(*range_doppler(samples), radar)

    def trace():
        yield "azimuths", programs.traced(azimuths, samples)[0]

    kind = jnp.float32 if radar.real_samples else jnp.complex64
    samples = jax.ShapeDtypeStruct(radar.cube_shape, kind)
    found = programs.ready(samples, "azimuths", radar, trace=trace)
    _viz()
    return found["azimuths"]


def _viz() -> Any:
    """Return `jradar.viz`, late: its matplotlib takes half a second to load."""
    from jradar import viz

    return viz
