"""`jradar calibrate`: a recording's echoes to a description with channel factors."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar.cli.reading import opening, summary
from jradar.errors import UsageError
from jradar.progress import progress
from jradar.radar import (
    RadarSpec,
    SelfCalibration,
    Snapshots,
    self_calibrate,
    strong_snapshots,
)
from jradar.recordings import (
    CaptureSpec,
    Recording,
    calibrated_cube,
    open_recording,
    with_sample_doubts,
    write_radar_toml,
)

MOST_FRAMES = 200


def calibrate_recording(options: argparse.Namespace) -> dict[str, Any]:
    """Fit the channels' factors, write them, and return residuals and doubts."""
    output = Path(options.output)
    if output.suffix != ".toml":
        raise UsageError(f"{output}: expected the name of a .toml file")
    recording = open_recording(options.path, **opening(options))
    frames = _frames(recording, options.frames)
    recording = with_sample_doubts(recording, frames[0])
    radar = recording.radar
    echoes = _echoes(recording, frames)
    found = self_calibrate(echoes, radar, reflector=options.reflector)
    before = recording.channel_factors
    factors = found.factors if before is None else found.factors * before
    bias_m = recording.range_bias_m
    if found.range_bias_m is not None:
        bias_m = found.range_bias_m
    capture = CaptureSpec(
        iq_order=recording.iq_order or CaptureSpec.iq_order,
        range_bias_m=bias_m,
        channel_factors=tuple(factors.tolist()),
    )
    comment = f"written by jradar calibrate from {recording.name}"
    write_radar_toml(output, radar, capture, axes=recording.axes, comment=comment)
    notes = () if found.improves else (_unchanged(found),)
    return {
        **summary(recording, notes),
        "frames used": len(frames),
        **_result(found, radar, factors),
        "range bias (m)": bias_m,
        "not observable": [*_hidden(radar, options.reflector)],
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
            cube = calibrated_cube(recording, frame)
            echoes = strong_snapshots(
                cube, recording.radar, coupling=recording.coupling
            )
            found.append(echoes)
            show(done)
    return jax.tree.map(lambda *columns: jnp.stack(columns), *found)


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


def _hidden(radar: RadarSpec, reflector) -> Iterator[str]:
    """Yield what the echoes do not show, in words."""
    if reflector is None:
        yield "a turn of all azimuths: the phase's slope along the columns is kept"
        if radar.has_elevation:
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
