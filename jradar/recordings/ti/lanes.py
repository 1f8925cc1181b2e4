"""Captures that lost half of their samples, because the radar sent on four LVDS lanes.

A DCA1000 takes two lanes from an xWR16xx, 18xx or 68xx. If the radar's configuration
enables four, the samples on the other two are lost:

    sent      0 1 2 3 4 5 6 7 ..
    stored    0 1     4 5     ..

Read as if nothing were missing, every echo appears twice, half the range axis apart,
and neither need be at its range. What is left still determines echoes in nearly the
first half of the range axis, where most of them are.
"""

import dataclasses
import functools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Inexact

from jradar.errors import UsageError
from jradar.options.sensor import RadarSpec
from jradar.recordings.ti.frame import CaptureSpec
from jradar.recordings.ti.iq_order import TWO_LANES

TAKEN = 2  # lanes, by the card
LEAST_SAMPLES = 32  # that are stored of a chirp
# Echoes from a little before 0 to nearly half the sample rate are restored, to -40 dB
# or better. Up to exactly half of it, an echo at a quarter would leave a ghost.
BAND = (-0.005, 0.475)
NOISE = 1e-3  # power relative to the echoes, for which the interpolation is best
# Evidence: peaks of the spectrum of every other sample that are clearly above the noise
# and made of one echo: even and odd samples then agree but for a phase.
CLEAR = 10.0  # times the median power
COHERENCE = 0.99
APART_RAD = 0.6  # by which the two hypotheses differ at a peak that can decide
NEAR_RAD = 0.3  # root mean square error of the right hypothesis
LEAST_SNAPSHOTS = 4  # chirps and receivers: fewer always agree
TWO = "LVDSLaneConfig(0, 1, 1, 0, 0, 1, 0, 0)"
ADVICE = (
    "half of the samples are missing: after each two that were stored, two were lost, "
    "as happens if four LVDS lanes are enabled and the card takes two. Each echo has a "
    "ghost half the range axis away, and ranges are wrong: record again with two "
    f"lanes, {TWO}. To use these samples, set lanes = 4 in [file] of a .toml, and "
    "num_samples and sample_rate_hz as they were configured"
)
WARNING = (
    "four LVDS lanes are enabled, and a card takes two from this board: half of the "
    f"samples may be lost, enable two with {TWO}"
)
NONE_MISSING = (
    "the description enables four LVDS lanes, but no samples are missing: they are "
    "read as they are"
)


def may_be_halved(radar: RadarSpec, lanes: int, order: str) -> bool:
    """Return whether a radar that sent on so many lanes may have lost samples."""
    whole = radar.num_samples % 4 == 0
    return lanes > TAKEN and order in TWO_LANES and whole


def warnings(radar: RadarSpec, capture: CaptureSpec) -> Iterator[str]:
    """Yield what a capture would lose, before it is recorded."""
    if may_be_halved(radar, capture.lanes, capture.iq_order):
        yield WARNING


def halved(radar: RadarSpec) -> RadarSpec:
    """Return the radar with half the samples, at half the rate, in the same time."""
    return dataclasses.replace(
        radar,
        num_samples=radar.num_samples // 2,
        sample_rate_hz=radar.sample_rate_hz / 2,
    )


def whole(radar: RadarSpec) -> RadarSpec:
    """Return the radar as it was configured; the inverse of `halved`."""
    return dataclasses.replace(
        radar,
        num_samples=2 * radar.num_samples,
        sample_rate_hz=2 * radar.sample_rate_hz,
    )


def refuse(path: Path, radar: RadarSpec, capture: CaptureSpec) -> None:
    """Raise UsageError for lanes that may have lost samples of a bag or a cube."""
    if may_be_halved(radar, capture.lanes, capture.iq_order):
        raise UsageError(
            f"{path}: its description enables {capture.lanes} LVDS lanes, of which a "
            "card takes 2, and only the lost samples of an adc_data.bin are "
            "interpolated: describe it in a .toml without lanes if none are missing"
        )


def note(radar: RadarSpec, missing: bool) -> str:
    """Return what to say of a capture on four lanes; `radar` is that of the frames."""
    if not missing:
        return NONE_MISSING
    range_m = 2 * BAND[1] * radar.max_range_m
    return (
        "four LVDS lanes were enabled, of which the card took two: half of the "
        f"samples are missing, and were interpolated. Echoes beyond {range_m:.3g} m, "
        "about half the range, show as ghosts before it, and the noise is 3 to 4 dB "
        f"higher: record again with two lanes, {TWO}"
    )


def restored(
    cube: Inexact[np.ndarray, "tx rx chirp stored"],
) -> Complex[np.ndarray, "tx rx chirp stored"]:
    """Return every other sample of whole chirps, of which 0, 1, 4, 5, .. are stored.

    Samples 0, 4, .. are kept, 2, 6, .. interpolated.
    """
    return (cube @ _interpolation(cube.shape[-1]).T).astype(np.complex64)


@functools.cache
def _interpolation(stored: int) -> np.ndarray:
    """Return the best linear estimate of samples from others, for echoes in `BAND`.

    Their frequencies are unknown: samples are correlated as those of a band of noise.
    """
    have = np.arange(2 * stored).reshape(-1, 4)[:, :2].ravel()
    want = np.arange(0, 2 * stored, 2)

    def correlation(first, second):
        time = first[:, None] - second
        middle, width = sum(BAND) / 2, BAND[1] - BAND[0]
        return np.exp(2j * np.pi * middle * time) * np.sinc(width * time)

    seen = correlation(have, have) + NOISE * np.eye(stored)
    weights = correlation(want, have) @ np.linalg.inv(seen)
    weights[::2] = have == want[::2, None]
    return weights


def samples_missing(cube: Inexact[np.ndarray, "tx rx chirp sample"]) -> bool | None:
    """Return whether the samples are 0, 1, 4, 5, .. of a chirp; None if it is unclear.

    An echo whose phase grows by a from sample to sample grows by 2 a between even
    samples if all are there, and by 4 a if half is missing.
    """
    chirps = np.asarray(cube).reshape(len(cube), -1, cube.shape[-1])
    if (
        not np.iscomplexobj(chirps)
        or chirps.shape[-1] < LEAST_SAMPLES
        or chirps.shape[-1] % 2
        or chirps.shape[1] < LEAST_SNAPSHOTS
    ):
        return None
    chirps = chirps - chirps.mean(-1, keepdims=True)
    size = chirps.shape[-1] // 2
    even, odd = (
        np.fft.fft(chirps[..., first::2] * np.hanning(size), axis=-1)
        for first in range(2)
    )
    power = np.sqrt((np.abs(even) ** 2).sum(1) * (np.abs(odd) ** 2).sum(1))
    both = (odd * even.conj()).sum(1)
    phase, (peak, place) = np.angle(both), _peaks(power)
    agree = np.abs(both) > COHERENCE * power
    clear = power > CLEAR * np.median(power, -1, keepdims=True)
    decides = np.abs(np.angle(np.exp(2j * phase))) > APART_RAD
    if not (used := peak & clear & agree & decides).any():
        return None
    step = 2 * np.pi * place / size
    whole, half = (
        np.angle(np.exp(1j * (step - times * phase)))[used] for times in (2, 4)
    )
    whole, half = (
        np.sqrt(np.average(error**2, weights=power[used])) for error in (whole, half)
    )
    if half < min(NEAR_RAD, whole / 2):
        return True
    return False if whole < NEAR_RAD else None


def _peaks(power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which bins are peaks, and the places of these between the bins."""
    left, right = np.roll(power, 1, -1), np.roll(power, -1, -1)
    low, middle, high = (np.log(np.maximum(p, 1e-30)) for p in (left, power, right))
    curve = low - 2 * middle + high
    offset = 0.5 * (low - high) / np.where(curve, curve, 1)
    place = np.arange(power.shape[-1]) + np.clip(offset, -0.5, 0.5)
    return (power > left) & (power >= right), place
