"""The frame that a file of TI's tools configures, whatever its format.

    chirps 0 to 2     of one profile, each fired by one transmitter: a turn
    frame             64 turns, every 100 ms

Chips can also send frames that a `RadarSpec` cannot describe: `radar_of_frame` refuses
them. Transmitters and receivers are counted from 0.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

import jradar
from jradar.errors import UsageError
from jradar.lidar import rigid_transform
from jradar.options.boards import BOARDS, Board
from jradar.options.sensor import RadarSpec
from jradar.recordings.text_files import radar_of

Number = int | float
MAX_CHIRPS = 512  # that a chip can store
MOST_SHOWN = 20  # chirps in a message
LARGEST = 2**16  # of counts and masks
PROFILE = {  # the numbers of a profile in their order, and their units in SI units
    "start_frequency_hz": 1e9,
    "idle_time_s": 1e-6,
    "adc_start_time_s": 1e-6,
    "ramp_end_time_s": 1e-6,
    "slope_hz_per_s": 1e12,
    "num_samples": 1,
    "sample_rate_hz": 1e3,
}


@dataclasses.dataclass(frozen=True)
class CaptureSpec:
    """How a board streams its samples, and how its channels differ.

    The defaults describe a capture that mmWave Studio configured.
    """

    iq_order: str = "IIQQ"  # of I and Q, see the module `iq_order`; "I": real samples
    has_headers: bool = False  # the stream holds more than samples
    range_bias_m: float = 0.0  # by which measured ranges are too long
    channel_factors: tuple[complex, ...] = ()  # per virtual antenna, in cube order
    mount: tuple[float, ...] = ()  # on the base: x y z and a quaternion, if measured
    lanes: int = 0  # on which the radar sends, see the module `lanes`; 0 if unknown
    frames: int = 0  # that were asked for; 0 if unknown, or without end

    def radar(self, spec: RadarSpec) -> "jradar.Radar":
        """Return the radar with these factors, if they change anything, and bias."""
        channels = None
        if set(self.channel_factors) - {1}:
            factors = np.array(self.channel_factors, np.complex64)
            channels = factors.reshape(spec.num_tx, spec.num_rx)
        return jradar.Radar(spec, channels=channels, range_bias_m=self.range_bias_m)

    def base_from_radar(self) -> Float[np.ndarray, "4 4"] | None:
        """Return the measured place of the radar on its base, if there is one."""
        place = np.array(self.mount)
        return rigid_transform(place[:3], place[3:]) if self.mount else None


class Chirp(NamedTuple):
    """What distinguishes one chirp of a turn from the others."""

    profile: Number
    variations: Sequence[Number]  # of frequency, slope and times
    tx: list[int]  # that fire, the lowest first


def radar_of_frame(
    path: Path | str,
    device: str,
    *,
    profiles: Mapping[Number, Sequence[Number]],
    chirps: Mapping[int, Chirp],
    ends: Sequence[Number],
    turns: Number,
    period_s: Number,
    rx_mask: Number,
    tx_mask: Number | None = None,
) -> tuple[RadarSpec, list[int], list[int]]:
    """Return the radar, its transmitters in firing order, and its receivers.

    The firing order is also the order in a recorded file. `profiles` and `chirps` are
    those of each number, `ends` the first and last chirp of a turn. Raises UsageError
    if the device has another band or fewer transmitters. Raises ValueError for frames
    that a `RadarSpec` cannot describe: several kinds of chirps, transmitters that fire
    together, or a transmitter that fires twice in a turn.
    """
    board, turn = board_of(device), chirp_range(path, ends)
    if not set(turn) <= set(chirps):
        raise ValueError(
            f"{path}: incomplete configuration: a frame sends chirps {turn[0]} to "
            f"{turn[-1]}, described are {sorted(chirps)[:MOST_SHOWN]}"
        )
    fired = [chirps[number] for number in turn]
    number = fired[0].profile
    if any(chirp.profile != number or any(chirp.variations) for chirp in fired):
        raise ValueError(
            f"{path}: the chirps of a frame differ in profile, frequency, slope or "
            "times, expected one profile without variations"
        )
    if number not in profiles:
        raise ValueError(
            f"{path}: the chirps use profile {number:g}, described are "
            f"{[*map(int, profiles)]}"
        )
    tx = [chirp.tx[0] for chirp in fired if len(chirp.tx) == 1]
    if len(tx) < len(fired) or len(set(tx)) < len(tx):
        raise ValueError(
            f"{path}: the chirps of a frame fire transmitters "
            f"{[chirp.tx for chirp in fired]}, expected each chirp to fire one, and "
            "each transmitter to fire once"
        )
    rx = [bit for bit in bits(path, rx_mask) if bit < len(board.rx_positions)]
    enabled = tx if tx_mask is None else bits(path, tx_mask)
    if not rx or not set(tx) <= set(enabled):
        raise ValueError(
            f"{path}: receivers {rx} and transmitters {enabled} are enabled, the frame "
            f"needs at least one receiver and transmitters {tx}"
        )
    numbers = zip(PROFILE.items(), profiles[number], strict=True)
    fields = {name: value * unit for (name, unit), value in numbers}
    start, (low, high) = fields["start_frequency_hz"], board.band_hz
    if max(tx) >= len(board.tx_positions) or not low <= start <= high:
        raise UsageError(
            f"{path}: the frame fires transmitters {tx} at {start / 1e9:g} GHz, the "
            f"{device} has {len(board.tx_positions)}, and works from {low / 1e9:g} to "
            f"{high / 1e9:g} GHz: name the board, one of {', '.join(BOARDS)}"
        )
    fields |= {
        "device": device,
        "num_samples": whole(f"{path}: num_samples", fields["num_samples"]),
        "num_chirps": whole(f"{path}: num_chirps", turns),
        "frame_period_s": period_s,
        "tx_positions": tuple(board.tx_positions[number] for number in tx),
        "rx_positions": tuple(board.rx_positions[number] for number in rx),
    }
    return radar_of(path, fields), tx, rx


def board_of(device: str) -> Board:
    """Return the board of that name; UsageError if it is unknown."""
    if device not in BOARDS:
        raise UsageError(f"device = {device!r}, expected one of {', '.join(BOARDS)}")
    return BOARDS[device]


def chirp_range(place: Path | str, ends: Sequence[Number]) -> range:
    """Return the numbers of chirps from first to last; errors begin with `place`."""
    first, last = (whole(f"{place}: a chirp's number", end) for end in ends)
    if not first <= last < MAX_CHIRPS:
        raise ValueError(
            f"{place}: chirps {first} to {last}, expected 0 to {MAX_CHIRPS - 1} in "
            "rising order"
        )
    return range(first, last + 1)


def bits(place: Path | str, mask: Number) -> list[int]:
    """Return the numbers of the bits that a mask sets, the lowest first."""
    number = whole(f"{place}: a mask", mask)
    return [bit for bit in range(number.bit_length()) if number >> bit & 1]


def whole(place: str, value: Number) -> int:
    """Return a number that counts; files may write it with decimals."""
    if not 0 <= value < LARGEST or value != int(value):
        raise ValueError(
            f"{place} = {value:g}, expected a whole number from 0 to {LARGEST - 1}"
        )
    return int(value)
