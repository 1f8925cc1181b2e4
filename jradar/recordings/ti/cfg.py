"""Radar and sample stream in a `.cfg` of TI's mmWave SDK: boards 1443 to 6843, 2944.

    channelCfg 15 7 0               bit masks of the receivers and transmitters in use
    adcCfg 2 1                      bits and format of a sample
    adcbufCfg -1 0 1 1 1            order of I and Q, and of the receivers
    profileCfg 0 77 267 7 57.14 ..  chirp: GHz, us, .., MHz/us, .., samples, ksps
    chirpCfg 1 1 0 0 0 0 0 4        chirp 1 of profile 0, fired by mask 4: transmitter 2
    frameCfg 0 2 16 0 100 ..        first and last chirp of a turn, turns, frames, ms
                                    (2944: samples per chirp before the ms)

A repeated command replaces the earlier one (a profile or chirp: the one of the same
number), and `flushCfg` deletes all. Commands that do not affect samples are skipped.
"""

import dataclasses
import math
import re
import warnings
from pathlib import Path

import numpy as np

from jradar.errors import UsageError
from jradar.radar import Radar, RadarSpec
from jradar.radar.devices import BOARDS, ROW_OF_RECEIVERS, Board
from jradar.recordings.text_files import radar_of, read_text
from jradar.recordings.ti.studio_log import MAX_CHIRPS, one_tx_each

# The commands that are read, and the fewest fields of each: files omit trailing ones.
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
    "antPhaseRot": 1,
}
NEEDED = ("channelCfg", "adcCfg", "adcbufCfg", "profileCfg", "chirpCfg", "frameCfg")
NUM_RX = len(ROW_OF_RECEIVERS)
CHOICES = f"name the board, one of {', '.join(BOARDS)}"


@dataclasses.dataclass(frozen=True)
class CaptureSpec:
    """How a board streams its samples, and how its channels differ.

    The defaults describe a capture that mmWave Studio configured.
    """

    iq_order: str = "IIQQ"  # of I and Q, see the module `iq_order`; "I": real samples
    has_headers: bool = False  # the stream holds more than samples
    range_bias_m: float = 0.0  # by which measured ranges are too long
    channel_factors: tuple[complex, ...] = ()  # per virtual antenna, in cube order

    def radar(self, spec: RadarSpec) -> Radar:
        """Return the radar with these factors, if they change anything, and bias."""
        channels = None
        if set(self.channel_factors) - {1}:
            factors = np.array(self.channel_factors, np.complex64)
            channels = factors.reshape(spec.num_tx, spec.num_rx)
        return Radar(spec, channels=channels, range_bias_m=self.range_bias_m)

    @classmethod
    def from_cfg(cls, path: Path | str, *, device: str = "awr1843") -> "CaptureSpec":
        """Read the stream of a `.cfg`; errors as in `radar_from_cfg`.

        The file lists a factor for each pair of antennas on the board, 4 for each bit
        of a transmitter. `channel_factors` holds the pairs in use, in firing order. Of
        a file without factors, they are the signs of the board's receivers: measured
        factors include these, unless `antPhaseRot` lists the signs separately.
        """
        board = _board(device)
        commands = _frame_commands(path, board)
        _, tx, rx = _turn(path, commands)
        _, sample_swap, non_interleaved = _sample_order(commands)
        orders = ("IIQQ", "QQII") if non_interleaved else ("I4Q4", "Q4I4")
        orders = ("I", "I") if board.real_samples else orders
        _, has_headers = commands.get("lvdsStreamCfg", [[-1, 0]])[-1][:2]
        neutral = [0.0] + [1.0, 0.0] * (NUM_RX * len(board.tx_positions))
        bias_m, *parts = commands.get("compRangeBiasAndRxChanPhase", [neutral])[-1]
        needed = NUM_RX * max(tx) + max(rx) + 1
        if len(parts) % 2:
            raise ValueError(
                f"{path}: compRangeBiasAndRxChanPhase has {len(parts)} numbers after "
                "the bias, expected pairs of real and imaginary parts"
            )
        factors = np.array(parts, float).view(complex)
        if len(factors) < needed:
            raise ValueError(
                f"{path}: compRangeBiasAndRxChanPhase holds {len(factors)} complex "
                f"factors, transmitters {tx} with receivers {rx} need {needed}"
            )
        signs = np.resize(board.rx_signs, len(factors))
        if "antPhaseRot" in commands:
            signs = np.array(commands["antPhaseRot"][-1])
        elif (factors != 1).any():
            signs = np.ones(len(factors))
        if len(signs) < needed or (abs(signs) != 1).any():
            raise ValueError(
                f"{path}: antPhaseRot holds {signs.tolist()}, expected {needed} or "
                "more numbers, each 1 or -1"
            )
        factors = (factors[:needed] * signs[:needed]).tolist()
        return cls(
            iq_order=orders[bool(sample_swap)],
            has_headers=bool(has_headers),
            range_bias_m=bias_m,
            channel_factors=tuple(factors[NUM_RX * t + r] for t in tx for r in rx),
        )


def radar_from_cfg(path: Path | str, *, device: str = "awr1843") -> RadarSpec:
    """Return the radar that a `.cfg` of TI's mmWave SDK configures on a board.

    Transmitters are in firing order, which is also their order in the recorded file.
    Raises UsageError for a `device` that is unknown or has another band or fewer
    transmitters. Raises ValueError for samples that the board does not deliver, and for
    frames that a `RadarSpec` cannot describe: several kinds of chirps, transmitters
    that fire together, or a transmitter that fires twice in a turn.
    """
    board = _board(device)
    commands = _frame_commands(path, board)
    profile, tx, rx = _turn(path, commands)
    if max(tx) >= len(board.tx_positions):
        raise UsageError(
            f"{path}: the frame fires transmitters {tx}, the {device} has "
            f"{len(board.tx_positions)}: {CHOICES}"
        )
    start_ghz, idle_us, adc_start_us, ramp_end_us = profile[1:5]
    low_hz, high_hz = board.band_hz
    if not low_hz <= start_ghz * 1e9 <= high_hz:
        raise UsageError(
            f"{path}: chirps start at {start_ghz} GHz, the {device} works from "
            f"{low_hz / 1e9:.0f} to {high_hz / 1e9:.0f} GHz: {CHOICES}"
        )
    turns, *_, period_ms = _frame(commands)
    fields = {
        "name": device,
        "start_frequency_hz": start_ghz * 1e9,
        "slope_hz_per_s": profile[7] * 1e12,
        "sample_rate_hz": profile[10] * 1e3,
        "num_samples": _whole(path, "profileCfg", profile[9]),
        "num_chirps": _whole(path, "frameCfg", turns),
        "idle_time_s": idle_us * 1e-6,
        "adc_start_time_s": adc_start_us * 1e-6,
        "ramp_end_time_s": ramp_end_us * 1e-6,
        "tx_positions": tuple(board.tx_positions[t] for t in tx),
        "rx_positions": tuple(board.rx_positions[r] for r in rx),
        "design_frequency_hz": board.design_frequency_hz,
        "frame_period_s": period_ms * 1e-3,
        "row_spacing": board.row_spacing,
        "real_samples": board.real_samples,
    }
    return radar_of(path, fields)


def _board(device: str) -> Board:
    if device not in BOARDS:
        raise UsageError(f"device = {device!r}: {CHOICES}")
    return BOARDS[device]


def _frame(commands) -> list[float]:
    """Return turns, frames and period of a frame; newer SDKs put samples before it."""
    fields = commands["frameCfg"][-1]
    return [*fields[2:4], fields[5 if len(fields) > 7 else 4]]


def _frame_commands(path: Path | str, board: Board) -> dict[str, list[list[float]]]:
    """Return the commands of a file of one kind of frame and the board's samples."""
    commands = _commands(path)
    mode = commands.get("dfeDataOutputMode", [[1]])[-1][0]
    if mode == 3 or "advFrameCfg" in commands or "subFrameCfg" in commands:
        raise ValueError(
            f"{path}: advanced frames (dfeDataOutputMode 3, advFrameCfg, subFrameCfg) "
            "mix several kinds of chirps, expected mode 1 with one frameCfg"
        )
    if mode != 1:
        raise ValueError(f"{path}: dfeDataOutputMode {mode:g}, expected 1: frames")
    if missing := ", ".join(name for name in NEEDED if name not in commands):
        raise ValueError(f"{path}: no {missing}: is it a .cfg of TI's mmWave SDK?")
    adc_format = commands["adcCfg"][-1][1]
    real = adc_format == 0 or _sample_order(commands)[0] == 1
    if real != board.real_samples:
        kinds = ("real", "complex") if real else ("complex", "real")
        raise ValueError(
            f"{path}: adcCfg or adcbufCfg selects {kinds[0]} samples, expected "
            f"{kinds[1]} ones (adcCfg 2 {int(real)}): {CHOICES}"
        )
    if adc_format == 2:
        warnings.warn(
            f"{path}: complex 2x samples: the upper half of the range bins is the "
            "image band, not range",
            stacklevel=4,
        )
    return commands


def _commands(path: Path | str) -> dict[str, list[list[float]]]:
    """Return the fields of each command that is read, in file order."""
    text = read_text(path, errors="replace")
    if kind := {"{": "JSON", "[": "JSON", "<": "XML"}.get(text.lstrip()[:1]):
        raise ValueError(f"{path} is {kind}, expected a .cfg of TI's mmWave SDK")
    commands = {}
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


def _turn(path, commands) -> tuple[list[float], list[int], list[int]]:
    """Return the profile of the chirps, transmitters in firing order, receivers."""
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
    tx = one_tx_each(path, [_bits(path, "chirpCfg", chirp[5]) for chirp in chirps])
    masks = commands["channelCfg"][-1][:2]
    rx_on, tx_on = (_bits(path, "channelCfg", mask) for mask in masks)
    rx = [bit for bit in rx_on if bit < NUM_RX]
    if not rx or not set(tx) <= set(tx_on):
        raise ValueError(
            f"{path}: channelCfg enables receivers {rx} and transmitters {tx_on}, the "
            f"frame needs at least one receiver and transmitters {tx}"
        )
    return profiles[number], tx, rx


def _chirps(path, commands) -> list[list[float]]:
    """Return profile, four variations and transmitter mask of each chirp of a turn."""
    described = {}
    for fields in commands["chirpCfg"]:
        start, end = (_whole(path, "chirpCfg", v, MAX_CHIRPS) for v in fields[:2])
        described |= dict.fromkeys(range(start, end + 1), fields[2:8])
    ends = commands["frameCfg"][-1][:2]
    first, last = (_whole(path, "frameCfg", end, MAX_CHIRPS) for end in ends)
    turn = range(first, last + 1)
    if not turn or not set(turn) <= set(described):
        raise ValueError(
            f"{path}: frameCfg sends chirps {first} to {last}, chirpCfg describes "
            f"{sorted(described)}"
        )
    return [described[chirp] for chirp in turn]


def _sample_order(commands) -> list[float]:
    """Return format, sample swap, channel order; newer SDKs put a sub-frame first."""
    fields = commands["adcbufCfg"][-1]
    return fields[1:4] if len(fields) > 4 or fields[0] < 0 else fields[:3]


def _bits(path, name, value):
    """Return the numbers of the bits that a field sets, lowest first."""
    mask = _whole(path, name, value)
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]


def _whole(path, name: str, value: float, below: int = 2**16) -> int:
    """Return a field that counts as an integer; files may write it with decimals."""
    if value != int(value) or not 0 <= value < below:
        raise ValueError(
            f"{path}: {name} holds {value:g}, expected a whole number from 0 to "
            f"{below - 1}"
        )
    return int(value)
