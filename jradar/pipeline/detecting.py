"""Detects points in the frames of a recording one by one, as `jradar points` does.

`describe_recording` returns what `jradar info` shows of a recording and of one frame.
"""

import importlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Inexact

from jradar.motion import gravity_warnings, propose_offset
from jradar.pipeline.frames import ahead, chosen_frames, stamp_s
from jradar.pipeline.stages import Stages
from jradar.pipeline.warnings import Tally, no_echoes
from jradar.radar import PointSpec, RadarSpec, noise_statistics, strongest_echoes
from jradar.radar.echoes import NoiseStatistics
from jradar.recordings import (
    Recording,
    check_samples,
    describe,
    need_samples,
    with_sample_warnings,
)
from jradar.types import PointCloud

POINTS = PointSpec()
LEAST_CONFIDENCE = 0.1  # of an offset between two clocks
# From the middle of the view: boards hardly send or receive beyond. In 130 frames of
# seven real captures at most one of the strongest echoes lies there; with the antennas
# of another board, two or more do in a fifth of them.
EDGE_DEG, MOST_AT_EDGE = 75.0, 1
FULL = 2.0  # times the spread of pure noise, beyond which little of a map is noise


class Detected(NamedTuple):
    """One frame of a recording, and what the detector found in it."""

    number: int
    stamp_s: float | None  # None if the recording has no times
    samples: Inexact[Array, "tx rx chirp sample"]  # calibrated, without crossing chirps
    power: Float[Array, "doppler range"]
    points: PointCloud
    detected: int  # cells that the detector marked
    dropped: int  # of them, the weakest, for which the cloud has no room
    recorded: Inexact[np.ndarray, "tx rx chirp sample"]  # as they were read

    confidence: None = None  # detections have none of these
    unlikeness: None = None
    bare: bool = False

    @property
    def empty(self) -> bool:
        """True if the detector found nothing."""
        return not np.asarray(self.points.valid).any()

    def describe(self, radar: RadarSpec) -> dict[str, Any]:
        """Return the numbers of points, the samples, the noise and strongest echoes.

        To check the recorded samples takes longer than to detect.
        """
        numbers = self.recorded.size * (1 + np.iscomplexobj(self.recorded))
        check = check_samples(self.recorded)
        return {
            "frame": self.number,
            "points": int(np.asarray(self.points.valid).sum()),
            "detected": self.detected,
            "dropped": self.dropped,
            "saturated": round(check.share * numbers),
            "largest sample": check.largest,
            "share at full scale": check.share,
            "noise": _noise(noise_statistics(self.power, radar)),
            "echoes": self.echoes(radar),
        }

    def echoes(self, radar: RadarSpec) -> list[dict[str, Any]]:
        """Return the strongest echoes."""
        return [e._asdict() for e in strongest_echoes(self.points, radar)]


class Detection(Iterator[Detected]):
    """An iterator over a recording's frames, with warnings about all so far."""

    def __init__(self, recording: Recording, points: PointSpec, frames: range):
        """Compile; `detect_recording` describes the options."""
        self.recording, self.spec, self.frames = recording, points, frames
        self._stages = Stages(jax.random.key(0), recording.radar, None, points=points)
        self._dropped, self._tally = 0, Tally()
        self._iterator = self._run()

    def __next__(self) -> Detected:
        """Return the next frame."""
        frame = next(self._iterator)
        self._dropped += frame.dropped
        self._tally.add(frame)
        return frame

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the options and the frames so far."""
        found = [*self._shrunk()]
        if self._dropped:
            found.append(
                f"{self._dropped:,} detections were dropped, the weakest of frames "
                f"with more than {self.spec.capacity:,}: --capacity N keeps more"
            )
        return (*found, *self._tally.warnings(self.recording.radar))

    def _run(self) -> Iterator[Detected]:
        with ThreadPoolExecutor(1) as reader:
            for number, cube in ahead(reader, self._read, self.frames):
                observed = self._stages.observe(cube)
                power, _ = self._stages.detections(observed)
                assert observed.samples is not None and observed.detected is not None
                detected = int(observed.detected)
                yield Detected(
                    number=number,
                    stamp_s=stamp_s(self.recording, number),
                    samples=observed.samples,
                    power=power,
                    points=observed.points,
                    detected=detected,
                    dropped=max(detected - self.spec.capacity, 0),
                    recorded=cube,
                )

    def _read(self, number: int):
        return number, self.recording.cube(number)

    def _shrunk(self) -> Iterator[str]:
        """Yield a warning if a CFAR window that the user chose had to shrink."""
        asked, usual, fitted = (
            (points.guard, points.train)
            for points in (self.spec, POINTS, self._stages.spec)
        )
        radar = self.recording.radar.spec
        if asked not in (usual, fitted):
            yield (
                f"the CFAR window was shrunk to guard {fitted[0]}, train {fitted[1]}: "
                "a larger one does not fit into the map of "
                f"{radar.num_chirps} x {radar.num_range_bins} cells"
            )


def detect_recording(
    recording: Recording,
    *,
    points: PointSpec = POINTS,
    frames: slice | range = slice(None),
) -> Detection:
    """Return an iterator over the radar points of a recording's `frames`; host.

    Windows and angle bins of `points` are fitted to the radar. Raises UsageError for
    frames that the recording does not have.
    """
    need_samples(recording)
    chosen = chosen_frames(recording, frames)
    return Detection(with_sample_warnings(recording, chosen[0]), points, chosen)


def describe_recording(recording: Recording, *, frame: int = 0) -> dict[str, Any]:
    """Return `describe`, and the samples, noise and strongest echoes of one frame.

    A capture of your own rig with a LiDAR or poses also has the offset between the
    clocks.
    A recording of points alone has no samples to describe.
    """
    if recording.of_points:
        return describe(recording)
    radar, one = recording.radar.spec, range(frame, frame + 1)
    checked = with_sample_warnings(recording, chosen_frames(recording, one)[0])
    kinds = [POINTS]
    if radar.num_chirps > 1:
        kinds.append(PointSpec(remove_static=True))
    with ThreadPoolExecutor() as threads:  # which compile at the same time
        threads.submit(importlib.import_module, "scipy.special")  # for the noise; slow
        detections = [*threads.map(lambda kind: Detection(checked, kind, one), kinds)]
    (seen,), *moving = detections
    names = "frame", "largest sample", "share at full scale", "noise", "echoes"
    shown = seen.describe(radar)
    found = {name: shown[name] for name in names}
    for (seen_moving,) in moving:
        found["moving echoes"] = seen_moving.echoes(radar)
    own = (recording.path / "capture.toml").is_file()
    if own and not (recording.lidar is None and recording.poses is None):
        found["time offset"] = described_offset(recording)
    described = describe(checked)
    described["notes"] += gravity_warnings(recording)
    described["notes"] += [no_echoes([frame], 1)] if seen.empty else []
    described["notes"] += _misfits(radar, shown["echoes"])
    return {**described, **found}


def _noise(found: NoiseStatistics) -> dict[str, float | str]:
    """Return the noise of a frame, its spread in words."""
    spread, pure = found.spread_db, found.pure_noise_spread_db
    meaning = "most of the map is noise"
    if spread > FULL * pure:
        meaning = "echoes, leakage or interference fill much of the map"
    return {
        "floor_db": found.floor_db,
        "counts_per_sample": found.counts_per_sample,
        "spread": f"{spread:.1f} dB, of pure noise {pure:.1f} dB: {meaning}",
    }


def _misfits(radar: RadarSpec, echoes: list[dict[str, Any]]) -> Iterator[str]:
    """Yield what a radar cannot measure, and what its strongest echoes contradict."""
    if radar.num_chirps == 1:
        yield (
            "a frame has one chirp of each transmitter, and therefore no Doppler: all "
            "velocities are 0"
        )
    angles = np.radians([[e["azimuth_deg"], e["elevation_deg"]] for e in echoes])
    ahead = np.cos(angles).prod(-1) if echoes else np.ones(0)
    count = int((ahead < np.cos(np.radians(EDGE_DEG))).sum())
    if count > MOST_AT_EDGE:
        yield (
            f"{count} of the {len(echoes)} strongest echoes lie more than "
            f"{EDGE_DEG:.0f} degrees off the middle of the view, where a board hardly "
            f"sees: are the antennas those of {radar.name}, and do its transmitters "
            "fire in this order? Name the board with --device, or the antennas in a "
            ".toml"
        )


def described_offset(recording: Recording) -> dict[str, Any]:
    """Return the offset between the sensors' clocks, or why it is not estimated."""
    try:
        found = propose_offset(recording)
    except ValueError as error:
        return {"not estimated": str(error)}
    if found.confidence < LEAST_CONFIDENCE:
        reason = f"no offset stands out (confidence {found.confidence:.3f})"
        return {"not estimated": reason}
    return {
        "add to the radar's start (s)": found.seconds,
        "confidence, 0 to 1": found.confidence,
        "compared with": found.compared_with,
    }
