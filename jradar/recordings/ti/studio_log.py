"""Radar in a log of TI's mmWave Studio.

    API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,256,10000,0,0,30,0,

Each line holds a command and its arguments in register units. A repeated command
replaces the earlier one (a profile or chirp: the one of the same number). What is in
force at a FrameConfig or a SensorStart is one configuration; a log of several captures
holds several.
"""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jradar.errors import UsageError
from jradar.radar import RadarSpec
from jradar.radar.devices import BOARDS
from jradar.recordings.text_files import radar_of, read_text

# Register units of mmWave Studio (TI mmWave Link interface control document).
FREQUENCY_HZ = 3.6e9 / 2**26
SLOPE_HZ_PER_S = 3.6e9 * 900 / 2**26 * 1e6
TIME_S = 10e-9
FRAME_PERIOD_S = 5e-9
# The fields that are read of each command, by their places. A log ends every command
# with its result, 0. ChirpConfig: first, last, profile, 4 variations, transmitters.
FIELDS = {
    "ChannelConfig": {"rx_mask": 1},
    "AdcOutConfig": {"format": 1},
    "ProfileConfig": {
        **{"profile": 0, "start": 1, "idle": 2, "adc_start": 3, "ramp_end": 4},
        **{"slope": 7, "samples": 9, "rate_ksps": 10},
    },
    "FrameConfig": {"first": 0, "last": 1, "loops": 3, "period": 4},
}
LEAST_FIELDS = {
    "select_chip_version": 1,
    **{name: max(places.values()) + 1 for name, places in FIELDS.items()},
    "ChirpConfig": 8,
}
ENDS = ("FrameConfig", "SensorStart")  # of a configuration
MAX_CHIRPS = 512  # that a chip can store
LARGEST = 2**32  # a register has at most 32 bits
CHIPS = {board.studio_chip: board for board in BOARDS.values() if board.studio_chip}


class Configuration(NamedTuple):
    """The commands in force at a line of the log."""

    chip: list[str]  # the last one selected
    commands: dict[str, dict[str, int]]  # the last of each: its fields
    profiles: dict[int, dict[str, int]]  # of each number: the fields
    chirps: dict[tuple[int, int], list[int]]  # from first to last: the other fields

    @property
    def missing(self) -> list[str]:
        """The commands that have not been given."""
        given = {
            **self.commands,
            "select_chip_version": self.chip,
            "ChirpConfig": self.chirps,
        }
        return [name for name in LEAST_FIELDS if not given.get(name)]


def count_configurations(path: Path | str) -> int:
    """Return the number of complete configurations in a log, at least 1.

    Raises ValueError for a file of another kind and for a malformed line.
    """
    return sum(1 for _ in _replay(path))


def radar_from_studio_log(
    path: Path | str, *, configuration: int | None = None
) -> RadarSpec:
    """Return the radar in the log that mmWave Studio writes beside `adc_data.bin`.

    Of several configurations, counted from 1, the last is taken by default.
    Transmitters are in firing order, which is also their order in the recorded file.
    """
    count = count_configurations(path)
    number = count if configuration is None else configuration
    if not 1 <= number <= count:
        raise UsageError(f"{path} has no configuration {number}, expected 1 to {count}")
    chosen = next(itertools.islice(_replay(path), number - 1, None))
    chip = chosen.chip[-1]
    if chip not in CHIPS:
        raise ValueError(f"{path}: chip {chip}, expected one of {', '.join(CHIPS)}")
    board = CHIPS[chip]
    rx_mask = chosen.commands["ChannelConfig"]["rx_mask"]
    if chosen.commands["AdcOutConfig"]["format"] <= 0:
        raise ValueError(f"{path}: real samples were recorded, expected complex ones")
    profile, tx = _turn(path, chosen)
    frame = chosen.commands["FrameConfig"]
    if max(tx) >= len(board.tx_positions):
        raise ValueError(
            f"{path}: the chirps fire transmitters {tx}, counted from 0; an {chip} has "
            f"{len(board.tx_positions)}"
        )
    fields = {
        "name": chip.lower(),
        "start_frequency_hz": profile["start"] * FREQUENCY_HZ,
        "slope_hz_per_s": profile["slope"] * SLOPE_HZ_PER_S,
        "sample_rate_hz": profile["rate_ksps"] * 1e3,
        "num_samples": profile["samples"],
        "num_chirps": frame["loops"],
        "idle_time_s": profile["idle"] * TIME_S,
        "adc_start_time_s": profile["adc_start"] * TIME_S,
        "ramp_end_time_s": profile["ramp_end"] * TIME_S,
        "tx_positions": tuple(board.tx_positions[t] for t in tx),
        "rx_positions": tuple(
            place for bit, place in enumerate(board.rx_positions) if rx_mask >> bit & 1
        ),
        "design_frequency_hz": board.design_frequency_hz,
        "frame_period_s": frame["period"] * FRAME_PERIOD_S,
    }
    return radar_of(path, fields)


def one_tx_each(path: Path | str, fired: list[list[int]]) -> list[int]:
    """Return the one transmitter of each chirp of a turn, given the lists of all."""
    order = [tx[0] for tx in fired if len(tx) == 1]
    if len(order) < len(fired) or len(set(order)) < len(order):
        raise ValueError(
            f"{path}: the chirps of a frame fire transmitters {fired}, expected each "
            "chirp to fire one, and each transmitter to fire once"
        )
    return order


def _replay(path: Path | str) -> Iterator[Configuration]:
    """Yield each complete configuration; the object changes with the next line."""
    now, changed, found = Configuration([], {}, {}, {}), False, 0
    for number, line in enumerate(read_text(path, errors="replace").splitlines(), 1):
        name, _, rest = line.partition("API:")[2].partition(",")
        if name in LEAST_FIELDS:
            words = rest.rstrip(",").split(",")
            changed |= _apply(now, name, words, f"{path}, line {number}: {line!r:.120}")
        if name in ENDS and changed and not now.missing:
            changed, found = False, found + 1
            yield now
    if now.missing:
        names = ", ".join(now.missing)
        raise ValueError(f"{path}: no {names}: is it the log of mmWave Studio?")
    if not found:
        yield now


def _apply(now: Configuration, name: str, words: list[str], place: str) -> bool:
    """Carry out a command; return whether it changed the configuration."""
    if name == "select_chip_version":
        changed = now.chip != words[:1]
        now.chip[:] = words[:1]
        return changed
    try:
        numbers = [int(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) < LEAST_FIELDS[name] or max(map(abs, numbers)) > LARGEST:
        raise ValueError(
            f"{place}, expected {LEAST_FIELDS[name]} or more register values after "
            f"{name}"
        )
    if name == "ChirpConfig":
        first, last, *others = numbers
        if not 0 <= first <= last < MAX_CHIRPS:
            raise ValueError(
                f"{place}, expected chirps from 0 to {MAX_CHIRPS - 1} in rising order"
            )
        changed = now.chirps.pop((first, last), None) != others
        now.chirps[first, last] = others  # the latest stands last
        return changed
    fields = {key: numbers[at] for key, at in FIELDS[name].items()}
    changed = now.commands.get(name) != fields
    now.commands[name] = fields
    if name == "ProfileConfig":
        changed = now.profiles.get(fields["profile"]) != fields
        now.profiles[fields["profile"]] = fields
    return changed


def _turn(path, chosen: Configuration) -> tuple[dict[str, int], list[int]]:
    """Return the profile of the chirps of a frame, and transmitters in firing order."""
    described = {}
    for (first, last), others in chosen.chirps.items():
        described |= dict.fromkeys(range(first, last + 1), others)
    frame = chosen.commands["FrameConfig"]
    first, last = frame["first"], frame["last"]
    wanted = range(first, min(last, MAX_CHIRPS) + 1)
    if not wanted or not set(wanted) <= set(described):
        raise ValueError(
            f"{path}: incomplete configuration: a frame sends chirps {first} to "
            f"{last}, ChirpConfig describes {sorted(described)[:20]}"
        )
    turn = [described[chirp] for chirp in wanted]
    number = turn[0][0]
    if any(chirp[0] != number or any(chirp[1:5]) for chirp in turn):
        raise ValueError(
            f"{path}: the chirps of a frame differ in profile, frequency, slope or "
            "times, expected one profile without variations"
        )
    if number not in chosen.profiles:
        raise ValueError(
            f"{path}: the chirps use profile {number}, ProfileConfig describes "
            f"{[*chosen.profiles]}"
        )
    fired = [_transmitters(*chirp[5:]) for chirp in turn]
    return chosen.profiles[number], one_tx_each(path, fired)


def _transmitters(mask: int, *flags: int) -> list[int]:
    """Return the transmitters of a chirp, given as a mask, or by a flag of each.

    After a mask only the result follows, which is 0.
    """
    if any(flags):
        return [tx for tx, on in enumerate((mask, *flags)) if on]
    return [bit for bit in range(mask.bit_length()) if mask >> bit & 1]
