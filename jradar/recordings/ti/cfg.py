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

import math
import re
import warnings
from pathlib import Path

import numpy as np

from jradar.files import read_text
from jradar.options.boards import ROW_OF_RECEIVERS, Board
from jradar.options.sensor import RadarSpec
from jradar.recordings.ti.frame import (
    CaptureSpec,
    Chirp,
    bits,
    board_of,
    chirp_range,
    radar_of_frame,
)

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


def read_cfg(
    path: Path | str, *, device: str = "awr1843"
) -> tuple[RadarSpec, CaptureSpec]:
    """Return the radar that a `.cfg` configures on a board, and its sample stream.

    `channel_factors` are those of the pairs of antennas in use, in firing order. If the
    file has no factors, they are the signs of the board's receivers. Measured factors
    include these signs, unless `antPhaseRot` lists them separately. Raises
    UsageError for an unknown `device`, and ValueError for samples that the board does
    not deliver and as `radar_of_frame`.
    """
    board = board_of(device)
    commands = _frame_commands(path, board)
    counts, (rx_mask, tx_mask, *_) = (
        commands[name][-1] for name in ("frameCfg", "channelCfg")
    )
    chirps: dict[int, Chirp] = {}
    for fields in commands["chirpCfg"]:
        first, last, profile, *varied, mask = fields[:8]
        chirp = Chirp(profile, varied, bits(path, mask))
        chirps |= dict.fromkeys(chirp_range(path, (first, last)), chirp)
    radar, tx, rx = radar_of_frame(
        path,
        device,
        profiles={p[0]: [*p[1:5], p[7], *p[9:11]] for p in commands["profileCfg"]},
        chirps=chirps,
        ends=counts[:2],
        turns=counts[2],
        # Newer SDKs put the number of samples before the period.
        period_s=counts[5 if len(counts) > 7 else 4] * 1e-3,
        rx_mask=rx_mask,
        tx_mask=tx_mask,
    )
    _, sample_swap, non_interleaved = _sample_order(commands)
    orders = ("IIQQ", "QQII") if non_interleaved else ("I4Q4", "Q4I4")
    orders = ("I", "I") if board.real_samples else orders
    _, has_headers = commands.get("lvdsStreamCfg", [[-1, 0]])[-1][:2]
    bias_m, factors = _factors(path, commands, board, NUM_RX * max(tx) + max(rx) + 1)
    capture = CaptureSpec(
        iq_order=orders[bool(sample_swap)],
        has_headers=bool(has_headers),
        range_bias_m=bias_m,
        channel_factors=tuple(factors[NUM_RX * t + r] for t in tx for r in rx),
        frames=int(counts[3]),
    )
    return radar, capture


def _factors(path, commands, board: Board, needed: int) -> tuple[float, list[complex]]:
    """Return the bias of ranges, and the factors of the board's pairs of antennas."""
    neutral = [0.0] + [1.0, 0.0] * (NUM_RX * len(board.tx_positions))
    bias_m, *parts = commands.get("compRangeBiasAndRxChanPhase", [neutral])[-1]
    if len(parts) % 2 or len(parts) < 2 * needed:
        raise ValueError(
            f"{path}: compRangeBiasAndRxChanPhase has {len(parts)} numbers after the "
            f"bias, expected real and imaginary parts of {needed} factors or more"
        )
    factors = np.array(parts, float).view(complex)
    signs = np.resize(board.rx_signs, len(factors))
    if "antPhaseRot" in commands:
        signs = np.array(commands["antPhaseRot"][-1])
    elif (factors != 1).any():
        signs = np.ones(len(factors))
    if len(signs) < needed or (abs(signs) != 1).any():
        raise ValueError(
            f"{path}: antPhaseRot holds {signs.tolist()}, expected {needed} or more "
            "numbers, each 1 or -1"
        )
    return bias_m, (factors[:needed] * signs[:needed]).tolist()


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
            f"{kinds[1]} ones (adcCfg 2 {int(real)}): name the board"
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


def _sample_order(commands) -> list[float]:
    """Return format, sample swap, channel order; newer SDKs put a sub-frame first."""
    fields = commands["adcbufCfg"][-1]
    return fields[1:4] if len(fields) > 4 or fields[0] < 0 else fields[:3]
