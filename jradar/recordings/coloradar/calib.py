"""The radars in ColoRadar's calibration folders (Kramer et al. 2022), all text files.

    calib/single_chip/   waveform_cfg.txt  antenna_cfg.txt  coupling_calib.txt
    calib/cascade/       the same, and phase_frequency_calib.txt (JSON)

Arrays keep the files' order of transmitters, which ADC frames use as well.
"""

import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Complex, Float

from jradar.errors import UsageError
from jradar.files import read_json, read_text
from jradar.options.boards import CASCADE
from jradar.options.sensor import RadarSpec
from jradar.recordings.text_files import radar_of

# Keys of a waveform file and the fields of a radar, all in SI units.
FIELDS = {
    "num_adc_samples_per_chirp": "num_samples",
    "num_chirps_per_frame": "num_chirps",
    "adc_sample_frequency": "sample_rate_hz",
    "start_frequency": "start_frequency_hz",
    "idle_time": "idle_time_s",
    "adc_start_time": "adc_start_time_s",
    "ramp_end_time": "ramp_end_time_s",
    "frequency_slope": "slope_hz_per_s",
}
COUNTS = ("num_tx", "num_rx", "num_adc_samples_per_chirp", "num_chirps_per_frame")


def radar_from_coloradar(folder: Path | str) -> RadarSpec:
    """Return the radar in ColoRadar's `calib/single_chip` or `calib/cascade`.

    The files contain neither the frame period, which is 0 here, nor the firing order:
    for the cascade TI's default is assumed. Warns of times in wrong units, as in the
    released file of the cascade, and repairs them.
    """
    folder = Path(folder)
    path = folder / "waveform_cfg.txt"
    if not path.is_file():
        raise UsageError(f"no {path}, expected a folder such as calib/single_chip")
    waveform, antennas = _waveform(path), _antennas(folder / "antenna_cfg.txt")
    for kind in ("tx", "rx"):
        if len(antennas[kind]) != waveform[f"num_{kind}"]:
            raise ValueError(
                f"{folder}: antenna_cfg.txt places {len(antennas[kind])} {kind} "
                f"antennas, waveform_cfg.txt has num_{kind} = {waveform[f'num_{kind}']}"
            )
    fields = {
        "name": f"coloradar {folder.name}",
        **{field: waveform[key] for key, field in FIELDS.items()},
        "tx_positions": antennas["tx"],
        "rx_positions": antennas["rx"],
        "design_frequency_hz": antennas["F_design"] * 1e9,
    }
    if antennas["tx"] == CASCADE["tx_positions"]:
        fields["tx_firing_order"] = CASCADE["tx_firing_order"]
    return radar_of(folder, fields)


def read_coupling(path: Path | str) -> Complex[np.ndarray, "tx rx half_range"]:
    """Return the leakage between antennas in range bins 1 .. N/2.

    It is the `leakage` of a `Radar`.
    """
    head, _, data = read_text(path).partition("data:")
    pairs = (line.partition(":") for _, line in _lines(head))
    values = {key.strip(): value for key, _, value in pairs}
    keys = ("num_tx", "num_rx", "num_range_bins")
    if missing := [key for key in keys if key not in values]:
        raise ValueError(
            f"{path}: no {', '.join(missing)}, expected lines 'key: value', then data"
        )
    shape = [_count(path, key, values[key].strip()) for key in keys]
    halves = _numbers(path, [v for v in data.split(",") if v.strip()])
    if halves.size != 2 * math.prod(shape):
        raise ValueError(
            f"{path} holds {halves.size:,} numbers, {shape[0]} tx x {shape[1]} rx x "
            f"{shape[2]} complex range bins need {2 * math.prod(shape):,}: truncated?"
        )
    return halves.view(complex).reshape(shape).astype(np.complex64)


def read_frequency_phase(
    path: Path | str, radar: RadarSpec
) -> tuple[Complex[np.ndarray, "tx rx"], Float[np.ndarray, "tx rx"]]:
    """Return a radar's `channels` and `beat_bins` of its `phase_frequency_calib.txt`.

    The file holds the frequencies and phases that the pairs of antennas measured of one
    far target. Each pair then sees such a target as the first one does. Raises
    ValueError where slope or sampling rate of the measurement differ from the radar's
    by a factor of 1000 or more.
    """
    try:
        values = read_json(path)["antennaCalib"]
        shape = [_count(path, key, values[key]) for key in ("numTx", "numRx")]
        measured = [values["frequencySlope"], values["samplingRate"]]
        slope, rate = _numbers(path, measured).tolist()
        frequency = _numbers(path, values["frequencyCalibrationMatrix"])
        phase = _numbers(path, values["phaseCalibrationMatrix"])
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: {error!r}, expected antennaCalib with numTx, numRx, "
            "samplingRate, frequencySlope, frequencyCalibrationMatrix and "
            "phaseCalibrationMatrix"
        ) from error
    pairs = math.prod(shape)
    if (frequency.size, phase.size) != (pairs, 2 * pairs):
        raise ValueError(
            f"{path} holds {frequency.size} frequencies and {phase.size} parts of "
            f"phases, {shape[0]} tx x {shape[1]} rx need {pairs} and {2 * pairs}"
        )
    if not (slope > 0 and rate > 0):
        raise ValueError(
            f"{path}: frequencySlope = {slope}, samplingRate = {rate}, expected "
            "positive numbers"
        )
    phases = phase.view(complex).reshape(shape)
    if not phases.all():
        raise ValueError(f"{path}: a phase is 0, expected complex numbers other than 0")
    slopes, rates = radar.slope_hz_per_s / slope, rate / radar.sample_rate_hz
    for ratio, what in ((slopes, "slopes in Hz/s"), (rates, "sampling rates in Hz")):
        if not 1e-3 < ratio < 1e3:
            raise ValueError(
                f"{path}: the radar's and the calibration's {what} differ by a factor "
                f"of {ratio:.3g}, expected 0.001 to 1000: another unit?"
            )
    bins = frequency.reshape(shape)
    bins = (bins - bins[0, 0]) * (slopes * rates)
    return (phases[0, 0] / phases).astype(np.complex64), bins.astype(np.float32)


def _waveform(path: Path) -> dict[str, Any]:
    """Return the values of a waveform file, times in seconds."""
    values: dict[str, Any] = {}
    for number, line in _lines(read_text(path)):
        key, *rest = line.split()
        if key not in COUNTS and key not in FIELDS:
            continue
        if len(rest) != 1:
            raise ValueError(f"{path}, line {number}: {line!r}, expected 'key value'")
        if key in COUNTS:
            values[key] = _count(path, key, rest[0])
        else:
            values[key] = float(_numbers(path, rest)[0])
    if missing := [key for key in (*COUNTS, *FIELDS) if key not in values]:
        raise ValueError(f"{path}: no {', '.join(dict.fromkeys(missing))}")
    for key, low, high, factor in (
        ("adc_start_time", 1e-3, math.inf, 1e-6),  # longer than any chirp: microseconds
        ("ramp_end_time", 0, 1e-8, 1e6),  # shorter than any chirp: 1e-6 applied twice
    ):
        if low < (seconds := values[key]) < high:
            values[key] = seconds * factor
            warnings.warn(
                f"{path}: {key} = {seconds:g} s is impossible, read as "
                f"{values[key]:g} s (a known fault of ColoRadar's cascade)",
                stacklevel=3,
            )
    return values


def _antennas(path: Path) -> dict[str, Any]:
    """Return positions `tx` and `rx` in half wavelengths, and `F_design` in GHz."""
    found: dict[str, Any] = {"tx": {}, "rx": {}}
    for number, line in _lines(read_text(path)):
        match line.split():
            case ["tx" | "rx" as kind, *place] if len(place) == 3:
                index, azimuth, elevation = _numbers(path, place)
                found[kind][index] = (azimuth, elevation)
            case ["num_tx" | "num_rx" | "F_design" as key, value]:
                found[key] = float(_numbers(path, [value])[0])
            case _:
                raise ValueError(
                    f"{path}, line {number}: {line!r}, expected 'tx index azimuth "
                    "elevation', 'rx ..', num_tx, num_rx or F_design"
                )
    if "F_design" not in found:
        raise ValueError(f"{path}: no F_design, the design frequency in GHz")
    for kind in ("tx", "rx"):
        places = found[kind]
        count = int(found.get(f"num_{kind}", len(places)))
        if not count or count != len(places) or sorted(places) != [*range(count)]:
            raise ValueError(
                f"{path}: {kind} antennas {[int(i) for i in sorted(places)]}, expected "
                f"each of 0 to {count - 1} once"
            )
        if any(half % 1 for place in places.values() for half in place):
            raise ValueError(
                f"{path}: {kind} antennas at {[*places.values()]}, expected whole half "
                "wavelengths"
            )
        found[kind] = tuple(tuple(map(int, places[i])) for i in range(count))
    return found


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines without comments and blank lines."""
    for number, line in enumerate(text.splitlines(), 1):
        if line := line.partition("#")[0].strip():
            yield number, line


def _numbers(path, values) -> np.ndarray:
    try:
        numbers = np.array(values, dtype=float)
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path}: {error}, expected numbers") from error
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise ValueError(f"{path}: expected a list of finite numbers")
    return numbers


def _count(path, key, value) -> int:
    number = float(_numbers(path, [value])[0])
    if number < 1 or number % 1:
        raise ValueError(f"{path}: {key} = {value}, expected a whole number above 0")
    return int(number)
