"""`jradar calibrate`: a recording's echoes to a description with channel factors."""

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar.calibration import (
    SelfCalibration,
    Snapshots,
    Tilt,
    level_tilt,
    self_calibrate,
    strong_snapshots,
    untilted,
)
from jradar.cli.reading import opening, summary
from jradar.errors import UsageError
from jradar.progress import progress
from jradar.radar import PointSpec, RadarSpec, radar_points
from jradar.recordings import (
    CaptureSpec,
    Recording,
    open_recording,
    with_sample_doubts,
    write_radar_toml,
)
from jradar.types import PointCloud

MOST_FRAMES = 200
POINTS = PointSpec(capacity=512)  # that tell the motion
LARGEST_DOUBT_DEG = 2.5  # of the tilt


def calibrate_recording(options: argparse.Namespace) -> dict[str, Any]:
    """Fit the channels' factors, write them, and return residuals and doubts."""
    output = Path(options.output)
    if output.suffix != ".toml":
        raise UsageError(f"{output}: expected the name of a .toml file")
    if options.level and options.reflector:
        raise UsageError("--level and --reflector both fix the tilt: leave one out")
    recording = open_recording(options.path, **opening(options))
    frames = _frames(recording, options.frames)
    recording = with_sample_doubts(recording, frames[0])
    radar = recording.radar.spec
    echoes = _echoes(recording, frames)
    found = self_calibrate(echoes, radar, reflector=options.reflector)
    calibrated, tilt = recording.radar.with_factors(found.factors), None
    if options.level:
        clouds = _clouds(recording._replace(radar=calibrated), frames)
        tilt = level_tilt(clouds, radar, up=_up(recording))
        calibrated = calibrated.with_factors(untilted(tilt.sine, radar))
    if found.range_bias_m is not None:
        calibrated = dataclasses.replace(calibrated, range_bias_m=found.range_bias_m)
    write_radar_toml(
        output,
        calibrated,
        iq_order=recording.iq_order or CaptureSpec.iq_order,
        axes=recording.axes,
        comment=f"written by jradar calibrate from {recording.name}",
    )
    notes = () if found.improves else (_unchanged(found),)
    if tilt is not None and tilt.deviation > np.sin(np.radians(LARGEST_DOUBT_DEG)):
        notes += (_unsure(tilt),)
    return {
        **summary(recording, notes),
        "frames used": len(frames),
        **_result(found, radar, np.asarray(calibrated.channels).ravel()),
        "range bias (m)": float(calibrated.range_bias_m),
        **({} if tilt is None else _tilt(tilt)),
        "not observable": [*_hidden(radar, options)],
        "written": [str(output)],
    }


def _frames(recording: Recording, chosen: slice) -> range:
    """Return the frames to use, evenly spaced."""
    count = len(recording.cubes)
    frames = range(*chosen.indices(count))
    if not frames:
        raise UsageError(f"--frames: {recording.path} has frames 0 to {count - 1}")
    return frames[:: -(-len(frames) // MOST_FRAMES)]


def _echoes(recording: Recording, frames: range) -> Snapshots:
    """Return the strong echoes of the frames, `[frame, echo]`."""
    found = []
    with progress("calibrating", len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            found.append(strong_snapshots(recording.cube(frame), recording.radar))
            show(done)
    return jax.tree.map(lambda *columns: jnp.stack(columns), *found)


def _clouds(recording: Recording, frames: range) -> PointCloud:
    """Return the points of the frames, `[frame, point]`."""
    radar, found = recording.radar, []
    with progress("measuring the motion", len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            points = POINTS.fitted(radar.spec)
            found.append(radar_points(recording.cube(frame), radar, points=points))
            show(done)
    return jax.tree.map(lambda *columns: jnp.stack(columns), *found)


def _up(recording: Recording) -> tuple[float, float, float]:
    """Return the vertical along the radar's axes.

    It is the mean force on the IMU, or else the base's vertical, or the radar's.
    """
    up, imu, mount = np.array([0.0, 0.0, 1.0]), recording.imu, recording.base_from_radar
    if mount is None:
        return tuple(up)
    if imu is not None and recording.base_from_imu is not None:
        up = recording.base_from_imu[:3, :3] @ imu.force.mean(0)
    return tuple((mount[:3, :3].T @ up).tolist())


def _tilt(tilt: Tilt) -> dict[str, Any]:
    """Return what the motion says of the tilt."""
    sines = {"tilt (deg)": tilt.sine, "uncertainty of the tilt (deg)": tilt.deviation}
    angles = {
        name: float(np.degrees(np.arcsin(min(s, 1.0)))) for name, s in sines.items()
    }
    return {**angles, "frames that tell the tilt": tilt.frames}


def _unsure(tilt: Tilt) -> str:
    degrees = np.degrees(np.arcsin(min(tilt.deviation, 1.0)))
    return (
        f"the tilt is known to {degrees:.1f} degrees only: "
        "use more frames of steady motion ahead, among things that stand still"
    )


def _result(found: SelfCalibration, radar: RadarSpec, factors) -> dict[str, Any]:
    """Return residuals and factors as tables."""
    rows = {
        "phase of the best quarter of the echoes (deg)": "phase_deg",
        "share of their power not explained": "power_share",
        "peak to mean of all angle spectra": "peak_to_mean",
    }
    pairs = zip(np.ndindex(radar.num_tx, radar.num_rx), factors, strict=True)
    return {
        "echoes": found.echoes,
        "spread of azimuths (deg)": found.azimuth_spread_deg,
        "improves": found.improves,
        "model": "transmitter x receiver" if found.separable else "each pair",
        "uncertainty (deg)": found.uncertainty_deg,
        "residuals, echoes left out": [
            {
                "residual": name,
                "before": getattr(found.before, field),
                "after": getattr(found.after, field),
            }
            for name, field in rows.items()
        ],
        "channels": [
            {
                "tx": tx,
                "rx": rx,
                "gain (dB)": float(20 * np.log10(abs(factor))),
                "phase (deg)": float(np.degrees(np.angle(factor))),
            }
            for (tx, rx), factor in pairs
        ],
    }


def _unchanged(found: SelfCalibration) -> str:
    return (
        "echoes left out of the fit are not explained better by it (unexplained share "
        f"{found.before.power_share:.3g} before, {found.after.power_share:.3g} after): "
        "the channels stay as they are; they are calibrated, or the strong cells hold "
        "several echoes each"
    )


def _hidden(radar: RadarSpec, options: argparse.Namespace) -> Iterator[str]:
    """Yield what the echoes do not show, in words."""
    if options.reflector is None:
        yield "a turn of all azimuths: the phase's slope along the columns is kept"
        if radar.has_elevation and not options.level:
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
