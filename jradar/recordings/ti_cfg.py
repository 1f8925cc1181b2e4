"""Radar and sample stream described by a `.cfg` of TI's mmWave SDK, for 1443 to 6843.

    channelCfg 15 7 0               masks of the receivers and transmitters that are on
    adcCfg 2 1                      bits and format of a sample
    adcbufCfg -1 0 1 1 1            order of a sample's halves, and of the receivers
    profileCfg 0 77 267 7 57.14 ..  chirp: GHz, us, .., MHz/us, .., samples, ksps
    chirpCfg 1 1 0 0 0 0 0 4        chirp 1 of profile 0, fired by mask 4: transmitter 2
    frameCfg 0 2 16 0 100 ..        first and last chirp of a turn, turns, frames, ms

A command given again replaces the one before it (a profile or a chirp: of its number),
`flushCfg` forgets them all, and commands that say nothing of the samples are skipped.
"""

import dataclasses
import math
import re
import warnings
from pathlib import Path
from typing import Any

from jradar.radar import RadarSpec
from jradar.radar.devices import BOARDS, ROW_OF_RECEIVERS, board
from jradar.recordings.studio_log import in_turn
from jradar.recordings.text_files import radar_of, read_text

# Commands that are read, and how many fields of each: files leave out trailing ones.
LEAST_FIELDS = {
    "dfeDataOutputMode": 1,
    "channelCfg": 2,
    "adcCfg": 2,
    "adcbufCfg": 4,
    "profileCfg": 11,
    "chirpCfg": 8,
    "frameCfg": 5,
    "advFrameCfg": 0,
    "subFrameCfg": 0,
    "lvdsStreamCfg": 2,
    "compRangeBiasAndRxChanPhase": 1,
}
NEEDED = ("channelCfg", "adcCfg", "adcbufCfg", "profileCfg", "chirpCfg", "frameCfg")
NUM_CHIRPS = 512  # that a chip can hold
NUM_RX = len(ROW_OF_RECEIVERS)

Commands = dict[str, list[list[float]]]


@dataclasses.dataclass(frozen=True)
class CaptureSpec:
    """How a board streams its samples, and how its channels differ.

    `sample_swap`: the imaginary half comes first, Q0 Q1 I0 I1, else I0 I1 Q0 Q1.
    `interleaved`: receivers alternate from sample to sample, as on the 1443.
    `has_headers`: the stream is not of samples alone.
    `range_bias_m`: by how much measured ranges are too long.
    `channel_factors`: one per virtual antenna, for `calibrate_channels`.
    """

    sample_swap: bool
    interleaved: bool
    has_headers: bool
    range_bias_m: float
    channel_factors: tuple[complex, ...]

    @classmethod
    def from_cfg(cls, path: Path | str) -> "CaptureSpec":
        """Stream of a `.cfg`; ValueError as `RadarSpec.from_cfg`.

        The file holds factors of all the board's antennas, 4 for each transmitter bit,
        from which TI's object detection picks those that fire. Here they lie as in the
        cube, in firing order.
        """
        commands = _frame_commands(path)
        _, tx, rx = _turn(path, commands)
        _, sample_swap, non_interleaved = _sample_order(commands)
        _, has_headers = commands.get("lvdsStreamCfg", [[-1, 0]])[-1][:2]
        bias_m, factors = _channels(path, commands)
        needed = NUM_RX * max(tx) + max(rx) + 1
        if len(factors) < needed:
            raise ValueError(
                f"{path}: compRangeBiasAndRxChanPhase holds {len(factors)} complex "
                f"factors, transmitters {tx} with receivers {rx} need {needed}"
            )
        return cls(
            sample_swap=bool(sample_swap),
            interleaved=not non_interleaved,
            has_headers=bool(has_headers),
            range_bias_m=bias_m,
            channel_factors=tuple(factors[NUM_RX * t + r] for t in tx for r in rx),
        )


def radar_from_cfg(path: Path | str, *, device: str = "awr1843") -> RadarSpec:
    """The radar that a `.cfg` of TI's mmWave SDK configures on the board `device`.

    Raises ValueError for real samples, for frames that are no RadarSpec (several
    kinds of chirps, transmitters that fire together, a transmitter twice in a turn)
    and for a carrier outside the board's band.
    """
    return radar_of(path, radar_fields(path, device))


def radar_fields(path: Path | str, device: str = "awr1843") -> dict[str, Any]:
    """Fields of the radar that a `.cfg` configures on the board `device`.

    The transmitters are in the order in which the frame fires them, which is also their
    order in the recorded file.
    """
    antennas = board(device)
    commands = _frame_commands(path)
    profile, tx, rx = _turn(path, commands)
    if max(tx) >= len(antennas.tx_positions):
        raise ValueError(
            f"{path}: the frame fires transmitters {tx}, the {device} has "
            f"{len(antennas.tx_positions)}: another device?"
        )
    start_ghz, idle_us, adc_start_us, ramp_end_us = profile[1:5]
    low_hz, high_hz = antennas.band_hz
    if not low_hz <= start_ghz * 1e9 <= high_hz:
        raise ValueError(
            f"{path}: chirps start at {start_ghz} GHz, the {device} works from "
            f"{low_hz / 1e9:.0f} to {high_hz / 1e9:.0f} GHz: name the device, one of "
            f"{[*BOARDS]} (not for a 6843 ODS or AOP, whose array is another)"
        )
    turns, _, period_ms = commands["frameCfg"][-1][2:5]
    return {
        "name": device,
        "start_frequency_hz": start_ghz * 1e9,
        "slope_hz_per_s": profile[7] * 1e12,
        "sample_rate_hz": profile[10] * 1e3,
        "num_samples": _whole(path, "profileCfg", profile[9]),
        "num_chirps": _whole(path, "frameCfg", turns),
        "idle_time_s": idle_us * 1e-6,
        "adc_start_time_s": adc_start_us * 1e-6,
        "ramp_end_time_s": ramp_end_us * 1e-6,
        "tx_positions": tuple(antennas.tx_positions[t] for t in tx),
        "rx_positions": tuple(antennas.rx_positions[r] for r in rx),
        "design_frequency_hz": antennas.design_frequency_hz,
        "frame_period_s": period_ms * 1e-3,
    }


def _frame_commands(path: Path | str) -> Commands:
    """The commands of a file that describes complex samples of one kind of frame."""
    commands = _commands(path)
    mode = commands.get("dfeDataOutputMode", [[1]])[-1][0]
    if mode == 3 or "advFrameCfg" in commands or "subFrameCfg" in commands:
        raise ValueError(
            f"{path}: advanced frames (dfeDataOutputMode 3, advFrameCfg, subFrameCfg) "
            "mix several kinds of chirps, expected mode 1 with one frameCfg"
        )
    if mode != 1:
        raise ValueError(f"{path}: dfeDataOutputMode {mode:g}, expected 1: frames")
    if missing := [name for name in NEEDED if name not in commands]:
        raise ValueError(
            f"{path}: no {', '.join(missing)}: is it a .cfg of TI's mmWave SDK?"
        )
    adc_format = commands["adcCfg"][-1][1]
    if adc_format == 0 or _sample_order(commands)[0] == 1:
        raise ValueError(
            f"{path}: adcCfg or adcbufCfg asks for real samples, expected complex ones "
            "(adcCfg 2 1)"
        )
    if adc_format == 2:
        warnings.warn(
            f"{path}: complex 2x samples: the upper half of the range bins is the "
            "image band, not range",
            stacklevel=4,
        )
    return commands


def _commands(path: Path | str) -> Commands:
    """Fields of every command that is read, in the order of the file."""
    text = read_text(path, errors="replace")
    if kind := {"{": "JSON", "[": "JSON", "<": "XML"}.get(text.lstrip()[:1]):
        raise ValueError(f"{path} is {kind}, expected a .cfg of TI's mmWave SDK")
    commands: Commands = {}
    for number, line in enumerate(text.splitlines(), 1):
        name, *fields = re.split("[%#]", line)[0].split() or [""]
        if name == "flushCfg":
            commands.clear()
        if name not in LEAST_FIELDS:
            continue
        try:
            values = [float(field) for field in fields]
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: {name}: {error}") from error
        if len(values) < LEAST_FIELDS[name] or not all(map(math.isfinite, values)):
            raise ValueError(
                f"{path}, line {number}: {line.strip()!r}, expected at least "
                f"{LEAST_FIELDS[name]} numbers after {name}"
            )
        commands.setdefault(name, []).append(values)
    return commands


def _turn(
    path: Path | str, commands: Commands
) -> tuple[list[float], list[int], list[int]]:
    """Profile of the frame's chirps, transmitters in firing order, receivers."""
    chirps = _chirps(path, commands)
    number = chirps[0][0]
    if any(chirp[0] != number or any(chirp[1:5]) for chirp in chirps):
        raise ValueError(
            f"{path}: the chirps of a frame differ in profile, frequency, slope or "
            "times, expected one profile without variations"
        )
    profiles = {fields[0]: fields for fields in commands["profileCfg"]}
    if number not in profiles:
        raise ValueError(
            f"{path}: the chirps use profile {number:g}, profileCfg describes "
            f"{[*map(int, profiles)]}"
        )
    fired = [_bits(_whole(path, "chirpCfg", chirp[5])) for chirp in chirps]
    tx = in_turn(path, fired)
    rx_on, tx_on = (
        _bits(_whole(path, "channelCfg", mask))
        for mask in commands["channelCfg"][-1][:2]
    )
    rx = [bit for bit in rx_on if bit < NUM_RX]
    if not rx or not set(tx) <= set(tx_on):
        raise ValueError(
            f"{path}: channelCfg turns on receivers {rx} and transmitters {tx_on}, the "
            f"frame needs a receiver and transmitters {tx}"
        )
    return profiles[number], tx, rx


def _chirps(path: Path | str, commands: Commands) -> list[list[float]]:
    """Profile, four variations and transmitter mask of each chirp of a turn."""
    described: dict[int, list[float]] = {}
    for fields in commands["chirpCfg"]:
        start, end = (_whole(path, "chirpCfg", v, NUM_CHIRPS) for v in fields[:2])
        described |= dict.fromkeys(range(start, end + 1), fields[2:8])
    first, last = (
        _whole(path, "frameCfg", v, NUM_CHIRPS) for v in commands["frameCfg"][-1][:2]
    )
    turn = range(first, last + 1)
    if not turn or not set(turn) <= set(described):
        raise ValueError(
            f"{path}: a frame sends chirps {first} to {last}, chirpCfg describes "
            f"{sorted(described)}"
        )
    return [described[chirp] for chirp in turn]


def _sample_order(commands: Commands) -> list[float]:
    """Format, sample swap and channel order, after the sub-frame of newer SDKs."""
    fields = commands["adcbufCfg"][-1]
    return fields[1:4] if len(fields) > 4 or fields[0] < 0 else fields[:3]


def _channels(path: Path | str, commands: Commands) -> tuple[float, list[complex]]:
    """Range bias in metres and factors of all the board's pairs of antennas."""
    neutral = [0.0] + [1.0, 0.0] * (NUM_RX * 3)
    bias_m, *halves = commands.get("compRangeBiasAndRxChanPhase", [neutral])[-1]
    if len(halves) % 2:
        raise ValueError(
            f"{path}: compRangeBiasAndRxChanPhase has {len(halves)} numbers after the "
            "bias, expected pairs of real and imaginary parts"
        )
    pairs = zip(halves[::2], halves[1::2], strict=True)
    return bias_m, [complex(*pair) for pair in pairs]


def _bits(mask: int) -> list[int]:
    """Numbers of the bits that are set, the lowest first."""
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]


def _whole(path: Path | str, name: str, value: float, below: int = 2**16) -> int:
    """A field that counts; files may write it with decimals."""
    if value != int(value) or not 0 <= value < below:
        raise ValueError(
            f"{path}: {name} holds {value:g}, expected a whole number from 0 to "
            f"{below - 1}"
        )
    return int(value)
