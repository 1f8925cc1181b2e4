"""The channels of a recording's radar from its echoes, as `jradar calibrate` does."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jradar.calibration.level import Tilt, level_tilt, untilted
from jradar.calibration.mount import PITCH_AND_ROLL, Mount, mount_from_motion
from jradar.calibration.self_calibration import SelfCalibration, self_calibrate
from jradar.calibration.snapshots import strong_snapshots
from jradar.errors import UsageError
from jradar.motion import frame_velocities, gravity_warnings
from jradar.motion.scans import scan_poses
from jradar.progress import progress
from jradar.radar import PointSpec, Radar, RadarSpec, radar_points
from jradar.recordings import Recording, need_samples
from jradar.recordings.sample_checks import sample_warnings

MOST_FRAMES = 200
POINTS = PointSpec(capacity=512)  # that show the motion
LARGEST_UNCERTAINTY_DEG = 2.5  # of the tilt
LARGE_DEG = 3.0  # a tilt that must be more than two deviations

RESIDUALS = {
    "phase of the best quarter of the echoes (deg)": "phase_deg",
    "share of their power not explained": "power_share",
    "peak to mean of all angle spectra": "peak_to_mean",
}


class Calibration(NamedTuple):
    """A radar with the factors of its channels, and how far to trust them."""

    radar: Radar
    fit: SelfCalibration
    tilt: Tilt | None  # None unless it was asked for
    mount: Mount | None  # likewise
    frames: range  # that were used
    warnings: tuple[str, ...]
    hidden: tuple[str, ...]  # what the recording does not show, in words

    def describe(self) -> dict[str, Any]:
        """Return residuals, factors and tilt as tables."""
        fit, factors = self.fit, np.asarray(self.radar.channels)
        tables: dict[str, Any] = {
            "frames used": len(self.frames),
            "echoes": fit.echoes,
            "spread of azimuths (deg)": fit.azimuth_spread_deg,
            "improves": fit.improves,
            "model": "transmitter x receiver" if fit.separable else "each pair",
            "uncertainty (deg)": fit.uncertainty_deg,
            "residuals, echoes left out": [
                {
                    "residual": name,
                    "before": getattr(fit.before, field),
                    "after": getattr(fit.after, field),
                }
                for name, field in RESIDUALS.items()
            ],
            "channels": [
                {
                    "tx": tx,
                    "rx": rx,
                    "gain (dB)": float(20 * np.log10(abs(factor))),
                    "phase (deg)": float(np.degrees(np.angle(factor))),
                }
                for (tx, rx), factor in np.ndenumerate(factors)
            ],
            "range bias (m)": float(self.radar.range_bias_m),
        }
        if self.tilt is not None:
            tables["tilt (deg)"] = self.tilt.degrees
            tables["uncertainty of the tilt (deg)"] = self.tilt.deviation_deg
            tables["frames that show the tilt"] = self.tilt.frames
        if self.mount is not None:
            tables |= self.mount.describe()
        return tables | {"not observable": [*self.hidden]}


def calibrate_recording(
    recording: Recording,
    *,
    frames: slice = slice(None),
    reflector: tuple[float, float, float] | None = None,
    level: bool = False,
    mount: bool = False,
) -> Calibration:
    """Return the radar with the factors that explain its echoes; host.

    At most 200 of the `frames` are used, evenly spaced. `reflector` is that of
    `self_calibrate`. With `level`, the radar was carried over level ground, which shows
    the tilt. With `mount`, the radar's yaw and place on the base are estimated from its
    motion and the recorded poses, or else those of matched LiDAR scans. Raises
    UsageError without frames, and for `level` and `reflector` together.
    """
    if level and reflector:
        raise UsageError("--level and --reflector both fix the tilt: leave one out")
    need_samples(recording)
    chosen, radar = _evenly(recording, frames), recording.radar
    echoes = _of_each(recording, chosen, "calibrating", strong_snapshots, radar)
    fit = self_calibrate(echoes, radar.spec, reflector=reflector)
    calibrated, tilt = radar.with_factors(fit.factors), None
    if level:
        detect = functools.partial(radar_points, points=POINTS.fitted(radar.spec))
        clouds = _of_each(recording, chosen, "measuring the motion", detect, calibrated)
        tilt = level_tilt(clouds, radar.spec, up=_up(recording))
        _check_tilt(tilt)
        calibrated = calibrated.with_factors(untilted(tilt.sine, radar.spec))
    if fit.range_bias_m is not None:
        calibrated = dataclasses.replace(calibrated, range_bias_m=fit.range_bias_m)
    place = _mount(recording._replace(radar=calibrated), frames) if mount else None
    warnings: list[Iterable[str]] = [_warnings(fit, tilt)]
    if place is not None:
        warnings.append(place.warnings(matched=recording.poses is None))
    if level or mount:
        warnings.append(gravity_warnings(recording))
    return Calibration(
        radar=calibrated,
        fit=fit,
        tilt=tilt,
        mount=place,
        frames=chosen,
        warnings=(*sample_warnings(recording, chosen[0]), *itertools.chain(*warnings)),
        hidden=(
            *_hidden(radar.spec, reflector=reflector is not None, level=level),
            *([PITCH_AND_ROLL] if mount else ()),
        ),
    )


def _check_tilt(tilt: Tilt) -> None:
    """Raise ValueError for a large tilt that may as well be none."""
    deviation = tilt.deviation_deg
    if LARGE_DEG < abs(tilt.degrees) < 2 * deviation:
        raise ValueError(
            f"the tilt is {tilt.degrees:.1f} degrees with a deviation of "
            f"{deviation:.1f}, expected one of more than two deviations: walk "
            "straight ahead for longer, or leave out --level"
        )


def _mount(recording: Recording, frames: slice) -> Mount:
    """Return the radar's place by all frames: the filter needs their rate."""
    matched = recording.poses is None
    poses = scan_poses(recording) if recording.poses is None else recording.poses
    chosen = range(*frames.indices(len(recording.cubes)))
    with progress("measuring the motion", len(chosen), unit="frames") as show:
        velocities = frame_velocities(recording, frames=chosen, advance=show)
    described = recording.base_from_radar
    described = np.eye(4) if described is None else described
    return mount_from_motion(velocities, poses, described, matched=matched)


def _evenly(recording: Recording, frames: slice) -> range:
    count = len(recording.cubes)
    chosen = range(*frames.indices(count))
    if not chosen:
        raise UsageError(f"--frames: {recording.path} has frames 0 to {count - 1}")
    return chosen[:: -(-len(chosen) // MOST_FRAMES)]


def _of_each(
    recording: Recording, frames: range, what: str, measure: Callable, radar: Radar
) -> Any:
    """Return `measure(cube, radar)` of every frame, stacked; show the progress."""
    found = []
    with progress(what, len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            found.append(measure(recording.cube(frame), radar))
            show(done)
    return jax.tree.map(lambda *columns: jnp.stack(columns), *found)


def _up(recording: Recording) -> tuple[float, float, float]:
    """The vertical along the radar's axes: the IMU's mean force, or the base's z."""
    up, imu, mount = np.array([0.0, 0.0, 1.0]), recording.imu, recording.base_from_radar
    if mount is None:
        return tuple(up)
    if imu is not None and recording.base_from_imu is not None:
        up = recording.base_from_imu[:3, :3] @ imu.force.mean(0)
    return tuple((mount[:3, :3].T @ up).tolist())


def _warnings(fit: SelfCalibration, tilt: Tilt | None) -> Iterator[str]:
    if not fit.improves:
        before, after = fit.before.power_share, fit.after.power_share
        yield (
            "the fit does not explain better the echoes that it left out (unexplained "
            f"share {before:.3g} before, {after:.3g} after): the channels stay as they "
            "are; they are calibrated, or the strong cells hold several echoes each"
        )
    if tilt is not None and tilt.deviation_deg > LARGEST_UNCERTAINTY_DEG:
        yield (
            f"the tilt is known to {tilt.deviation_deg:.1f} degrees only: "
            "use more frames of steady motion ahead, among things that stand still"
        )


def _hidden(radar: RadarSpec, *, reflector: bool, level: bool) -> Iterator[str]:
    if not reflector:
        yield "a rotation of all azimuths: the phase's slope along the columns is kept"
        if radar.has_elevation and not level:
            yield (
                "a tilt of all elevations: the phase's slope along the rows is kept"
                + _alone_in_its_row(radar)
            )
        yield "the range bias: it is kept"
    yield "a gain and a phase that all channels share"


def _alone_in_its_row(radar: RadarSpec) -> str:
    """Name the transmitter whose antennas alone are the upper of two rows."""
    rows = radar.virtual_positions[:, 1].reshape(radar.num_tx, radar.num_rx)
    values = sorted({*rows.ravel().tolist()})
    if len(values) == 2:
        for value in values[::-1]:
            on_it = np.flatnonzero((rows == value).any(1))
            if len(on_it) == 1 and (rows[on_it[0]] == value).all():
                return f" (here the phase of transmitter {on_it[0]})"
    return ""
