"""Captures of radars that stand still, real ones and simulated ones, in numbers.

A standing radar shows what a scene's model leaves out: whether rooms echo at every
range, how the receiver's filter ends, how steady the phase is. Each number has a range
over the simulated units; a real capture outside that range is of a kind that no model
was trained on.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from jradar.errors import UsageError, parsing
from jradar.evaluation import markdown_table
from jradar.radar import RadarSpec
from jradar.radar.spectrum import window
from jradar.recordings import open_recording
from jradar.simulation import UnitSpec, draw_unit, make_setting, radar_frames
from jradar.simulation.hardware.hardware import make_unit_hardware

Cube = Complex[np.ndarray, "tx rx chirp sample"]

OPENRADAR = Path("openradar") / "doppler_example_1.npy"
AWR1642 = Path("dca1000") / "adc_data_0.bin"
AWR1843 = Path("awr1843_3tx") / "adc_data_Raw_0.bin"
OPENRADAR_CHIRPS = {
    "start_frequency_hz": 77.4201e9,
    "slope_hz_per_s": 60e12,
    "sample_rate_hz": 2.5e6,
    "idle_time_s": 30e-6,
    "ramp_end_time_s": 62e-6,
}
USUAL_CHIRPS = {  # the capture of the AWR1843 does not say its own
    "slope_hz_per_s": 60e12,
    "sample_rate_hz": 10e6,
    "idle_time_s": 10e-6,
    "ramp_end_time_s": 40e-6,
    "num_chirps": 64,
    "num_samples": 256,
}
CHIRPS = 128  # of the AWR1642's frames of one chirp each
ROOMS = ("hallways", "lab", "home")
UNITS, SEED, TIME_S = 12, 200, 2.0

NEAR, FAR = 4, 0.92  # range bins of the numbers: without leakage and the filter's edge
STILL = 2  # Doppler bins of a standing echo, on both sides of 0
PEAKS = 5  # strongest static echoes
FULL_DB = 20.0  # over the noise: an echo
ROUNDING = 1e-9  # relative


class Capture(NamedTuple):
    """A frame of a standing radar."""

    cube: Cube
    radar: RadarSpec


def real_captures(folder: Path) -> dict[str, Capture]:
    """Return the captures that `folder` holds. Raises UsageError for none."""
    found = {}
    if (path := folder / OPENRADAR).exists():
        found["OpenRadar"] = read_openradar(path)
    if (path := folder / AWR1642).exists():
        found["AWR1642"] = read_awr1642(path)
    if (path := folder / AWR1843).exists():
        found["AWR1843"] = read_awr1843(path)
    if not found:
        names = ", ".join(map(str, (OPENRADAR, AWR1642, AWR1843)))
        raise UsageError(f"{folder} holds no capture, expected some of {names}")
    return found


def read_openradar(path: Path) -> Capture:
    """Return OpenRadar's example, with signed samples."""
    with parsing(path, "a .npy file"):
        stored = np.load(path, allow_pickle=False)
    if stored.shape != (128, 8, 128) or not np.iscomplexobj(stored):
        raise ValueError(
            f"{path} holds {stored.dtype} of shape {stored.shape}, expected complex "
            "values of shape (128, 8, 128): chirps, antennas, samples"
        )
    real, imaginary = (
        part.astype("u2").view("i2").astype(np.float32)
        for part in (stored.real, stored.imag)
    )
    cube = (real + 1j * imaginary).reshape(128, 2, 4, 128).transpose(1, 2, 0, 3)
    return Capture(cube, RadarSpec.awr1642(**OPENRADAR_CHIRPS))


def read_awr1642(path: Path) -> Capture:
    """Return the first frames of one chirp each as the chirps of one frame."""
    recording = open_recording(path, frames_as_chirps=True)
    cube = np.asarray(recording.cubes[0])[:, :, :CHIRPS]
    # Movers of the simulated rooms would alias at the capture's 5 frames per second.
    radar = dataclasses.replace(recording.radar, num_chirps=CHIRPS, idle_time_s=30e-6)
    return Capture(cube, radar)


def read_awr1843(path: Path) -> Capture:
    """Return a raw frame of three transmitters, without a description next to it."""
    radar = RadarSpec.awr1843(**USUAL_CHIRPS)
    tx, rx, chirps, samples = radar.cube_shape
    words = np.fromfile(path, "<i2")
    if words.size != 2 * tx * rx * chirps * samples:
        raise ValueError(
            f"{path} holds {words.size:,} words, expected those of one frame of "
            f"{tx} tx x {rx} rx x {chirps} chirps x {samples} samples"
        )
    pairs = words.reshape(chirps, tx, rx, samples // 2, 2, 2)  # I0 I1 Q0 Q1
    parts = pairs.transpose(4, 1, 2, 0, 3, 5).reshape(2, tx, rx, chirps, samples)
    real, imaginary = parts.astype(np.float32)
    return Capture(real + 1j * imaginary, radar)


def simulated_captures(
    radar: RadarSpec, units: Sequence[UnitSpec], rooms: Sequence[str] = ROOMS
) -> Iterator[Capture]:
    """Yield a frame of each unit with the radar's chirps, standing in a room."""
    for number, unit in enumerate(units):
        room, seed = rooms[number % len(rooms)], SEED + number // len(rooms)
        setting = make_setting(room, seed, unit=unit)
        hardware = make_unit_hardware(unit, radar)
        setting = setting._replace(radars={"single_chip": (radar, hardware)})
        (frame,) = radar_frames(setting, "single_chip", np.array([TIME_S]))
        frame = np.asarray(frame, np.float32)
        yield Capture(frame[..., 0] + 1j * frame[..., 1], radar)


def one_unit(count: int = UNITS) -> list[UnitSpec]:
    """Return the unit of `jradar-sim-1`, standing still."""
    return [UnitSpec(speed_mps=0.0)] * count


def many_units(count: int = UNITS) -> list[UnitSpec]:
    """Return units of `jradar-sim-4`, standing still and without interference."""
    still = {"speed_mps": 0.0, "interferers": 0}
    units = (draw_unit(seed, population=2) for seed in range(count))
    return [dataclasses.replace(unit, **still) for unit in units]


class Comparison(NamedTuple):
    """A number of a real capture, and those of simulated ones."""

    capture: str
    number: str
    real: float
    one_unit: list[float]
    many_units: list[float]

    @property
    def inside(self) -> bool:
        """Whether the real number is in the range of the many units."""
        margin = ROUNDING * abs(self.real)
        low, high = min(self.many_units), max(self.many_units)
        return low - margin <= self.real <= high + margin


def compared(
    real: dict[str, Capture], made: dict[str, tuple[list[Capture], list[Capture]]]
) -> list[Comparison]:
    """Return the numbers of each real capture, with those of its simulated ones."""
    found = []
    for name, capture in real.items():
        one, many = ([standing_statistics(c.cube) for c in part] for part in made[name])
        for number, value in standing_statistics(capture.cube).items():
            columns = ([float(row[number]) for row in rows] for rows in (one, many))
            found.append(Comparison(name, number, float(value), *columns))
    return found


def comparison_table(found: list[Comparison]) -> str:
    """Return Markdown; simulated numbers are lowest / median / highest."""

    def spread(values):
        return " / ".join(f"{np.quantile(values, q):.3g}" for q in (0, 0.5, 1))

    titles = ["capture", "number", "real", "jradar-sim-1", "jradar-sim-4", "inside"]
    rows = [
        [
            *(c.capture, c.number, f"{c.real:.3g}"),
            *(
                spread(c.one_unit),
                spread(c.many_units),
                "yes" if c.inside else "**no**",
            ),
        ]
        for c in found
    ]
    return markdown_table(titles, rows)


def standing_statistics(cube: Cube) -> dict[str, float]:
    """Return numbers of a standing radar's frame, averaged over its antennas.

    The noise of a range bin is the median over the faster half of the velocities, and
    decibels are over its median in range.
    """
    *_, chirps, samples = cube.shape
    spectrum = np.fft.fft(cube * window("hann", samples)).reshape(-1, chirps, samples)
    slow = window("hann", chirps)[:, None]
    doppler = np.fft.fftshift(np.fft.fft(spectrum * slow, axis=1), axes=1)
    power = (np.abs(doppler) ** 2).mean(0)
    velocity = np.abs(np.arange(chirps) - chirps // 2)
    used = slice(NEAR, int(FAR * samples))
    noise = np.median(power[velocity > chirps // 4], 0)
    over = 10 * np.log10(power / np.median(noise[used]))
    static, moving = over[chirps // 2, used], power[velocity > STILL, used]
    end = np.median(noise[int(0.96 * samples) :])
    middle = np.median(noise[int(0.3 * samples) : int(0.8 * samples)])
    fast = over[velocity > STILL, used]
    peaks = strongest_peaks(static)
    return {
        "static echoes, weakest tenth of the ranges (dB)": np.percentile(static, 10),
        "static echoes, median over range (dB)": np.median(static),
        f"ranges with static echoes over {FULL_DB:g} dB (%)": 100
        * np.mean(static > FULL_DB),
        "noise at the largest range, relative to the middle (dB)": 10
        * np.log10(end / middle),
        "power outside zero velocity (%)": 100 * moving.sum() / power[:, used].sum(),
        "map outside zero velocity, 99.9 % quantile (dB)": np.percentile(fast, 99.9),
        "width of the strongest static echoes at -6 dB (bins)": float(
            np.mean([width(static, peak) for peak in peaks] or np.nan)
        ),
        "drift of their phase (mrad)": float(
            np.median([phase_drift(spectrum[..., k + NEAR]) for k in peaks] or np.nan)
        ),
    }


def strongest_peaks(level: Float[np.ndarray, " bin"]) -> np.ndarray:
    """Return the bins of the strongest local maxima that are echoes."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(level, 2, "edge"), 5)
    peaks = np.flatnonzero((level == around.max(1)) & (level > FULL_DB))
    return peaks[np.argsort(-level[peaks])][:PEAKS]


def width(level: Float[np.ndarray, " bin"], peak: int) -> int:
    """Return the number of bins around a peak that are at most 6 dB below it."""
    below = np.flatnonzero(level < level[peak] - 6)
    left, right = below[below < peak], below[below > peak]
    first = left[-1] if left.size else -1
    last = right[0] if right.size else len(level)
    return int(last - first - 1)


def phase_drift(echo: Complex[np.ndarray, "antenna chirp"]) -> float:
    """Return the rms deviation of an echo's phase from its mean over chirps, mrad."""
    rotation = (echo * np.conj(echo.mean(1, keepdims=True))).sum(0)
    return float(1e3 * np.std(np.unwrap(np.angle(rotation))))
