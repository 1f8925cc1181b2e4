"""Radar in a Lua script that sets up mmWave Studio.

    START_FREQ = 77
    ar1.SelectChipVersion("XWR1843")
    ar1.ChanNAdcConfig(1, 1, 1, 1, 1, 1, 1, 2, 1, 0)     transmitters, receivers, format
    ar1.DataPathConfig(513, 1216644097, 0)               interface, content
    ar1.LVDSLaneConfig(0, 1, 1, 0, 0, 1, 0, 0)           format, four lanes
    ar1.ProfileConfig(0, START_FREQ, 7, 5.28, 57, ..)    number; GHz, us, us, us
    ar1.ChirpConfig(0, 0, 0, 0, 0, 0, 0, 0, 1, 0)        first, last, .., transmitters
    ar1.FrameConfig(0, 2, 20, 1, 20, 0, 0, 1)            first, last, frames, turns, ms

Nothing is run. An argument is a number, or a variable that the script sets to one
number. Other forms, and calls that contradict one another, are refused with their line.
The orders of arguments are those that mmWave Studio's shell prints for `help ar1.NAME`.
"""

import bisect
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from jradar.errors import UsageError
from jradar.files import read_text
from jradar.options.boards import BOARDS
from jradar.options.sensor import RadarSpec
from jradar.recordings.ti.frame import (
    CaptureSpec,
    Chirp,
    board_of,
    chirp_range,
    radar_of_frame,
    whole,
)

# The calls that are read, and how many arguments each may have.
CALLS = {
    "ChanNAdcConfig": (10,),
    "DataPathConfig": (3,),
    "LVDSLaneConfig": (8,),
    "ProfileConfig": (18,),
    "ChirpConfig": (10,),
    "FrameConfig": (6, 7, 8),
}
NEEDED = ("ChanNAdcConfig", "ProfileConfig", "ChirpConfig", "FrameConfig")
# Which arguments of a call count, after those that number what it sets.
FIELDS = {
    "ChanNAdcConfig": (*range(7), 8, 9),
    "DataPathConfig": (0, 1),
    "LVDSLaneConfig": (1, 2, 3, 4),
    # start, idle, ADC start and ramp end; slope; samples, rate
    "ProfileConfig": (1, 2, 3, 4, 11, 13, 14),
    "ChirpConfig": tuple(range(2, 10)),
    "FrameConfig": (0, 1, 2, 3, 4),
}
LARGEST = 2**32  # of an argument
DEFAULT_BOARD = "awr1843"
LVDS, SAMPLES_ONLY = 1, 1  # the low bytes of DataPathConfig's arguments
REAL, COMPLEX, COMPLEX_2X = 0, 1, 2
# What does not end, ends with the line, or the file: then a damaged file is read once.
QUOTED = re.compile(
    r"--\[(=*)\[.*?(?:\]\1\]|\Z)|--[^\n]*|\[\[.*?(?:\]\]|\Z)"
    r"|\"(?:\\.|[^\"\\\n])*(?:\"|(?=\n)|\Z)|'(?:\\.|[^'\\\n])*(?:'|(?=\n)|\Z)",
    re.DOTALL,
)
NAME = r"[A-Za-z_][\w.]*"
NUMBER = re.compile(r"-?(?:0[xX][\da-fA-F]{1,16}|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)")
SETS = re.compile(rf"^[ \t]*(?:local[ \t]+)?({NAME})[ \t]*=(?!=)[ \t]*(.*)$", re.M)
CALL = re.compile(rf"\bar1\s*\.\s*({'|'.join(CALLS)})\s*\(([^()]*)([()]|\Z)", re.I)
CHIP = re.compile(r"\bar1\s*\.\s*SelectChipVersion\s*\(\s*[\"'](\w+)[\"']\s*\)")


class Call(NamedTuple):
    """The arguments of a call that count, and the line where it stands."""

    line: int
    values: tuple[float, ...]


def read_lua(
    path: Path | str, *, device: str | None = None
) -> tuple[RadarSpec, CaptureSpec, tuple[str, ...]]:
    """Return the radar that a script of mmWave Studio sets up, and its sample stream.

    `device` is the board, by default that of the chip in `SelectChipVersion`. Raises
    ValueError, with the line, for calls that cannot be read, and errors as
    `radar_of_frame`.
    """
    text = _without_comments(read_text(path, errors="replace"))
    board, notes = _board(path, text, device)
    calls = {name: dict[int, Call]() for name in CALLS}
    for name, number, call in _calls(path, text):
        earlier = calls[name].setdefault(number, call)
        if earlier.values != call.values:
            raise ValueError(
                f"{path}, line {call.line}: {name} differs from line {earlier.line}, "
                "and which of them ran is not known: leave one of them"
            )
    if missing := ", ".join(name for name in NEEDED if not calls[name]):
        raise ValueError(f"{path}: no ar1.{missing}: is it a script of mmWave Studio?")
    channels, frame = calls["ChanNAdcConfig"][0], calls["FrameConfig"][0]
    order = _sample_order(path, channels, board)
    _check_stream(path, calls["DataPathConfig"].get(0))
    first, last, frames, turns, period_ms = frame.values
    chirps = {
        number: Chirp(v[0], v[1:5], [tx for tx, on in enumerate(v[5:]) if on])
        for number, (_, v) in calls["ChirpConfig"].items()
    }
    radar, tx, rx = radar_of_frame(
        path,
        board,
        profiles={
            number: call.values for number, call in calls["ProfileConfig"].items()
        },
        chirps=chirps,
        ends=(first, last),
        turns=turns,
        period_s=period_ms * 1e-3,
        rx_mask=_mask(channels.values[3:7]),
        tx_mask=_mask(channels.values[:3]),
    )
    lanes = calls["LVDSLaneConfig"].get(0)
    signs = BOARDS[board].rx_signs
    capture = CaptureSpec(
        iq_order=order,
        channel_factors=tuple(complex(signs[r]) for _ in tx for r in rx),
        lanes=0 if lanes is None else sum(map(bool, lanes.values)),
        frames=int(frames),
    )
    return radar, capture, notes


def _without_comments(text: str) -> str:
    """Return a script without comments and texts, but for single words in quotes."""

    def kept(match: re.Match) -> str:
        found = match[0]
        if re.fullmatch(r"[\"']\w+[\"']", found):
            return found
        blank = "" if found.startswith("--") else '""'
        return blank + "\n" * found.count("\n")

    return QUOTED.sub(kept, text)


def _calls(path: Path | str, text: str) -> Iterator[tuple[str, int, Call]]:
    """Yield the name of each call, the number of what it sets, and its arguments."""
    ends = [match.start() for match in re.finditer("\n", text)]
    variables = dict[str, set[str]]()
    for match in SETS.finditer(text):
        variables.setdefault(match[1], set()).add(match[2].strip().rstrip(";").strip())
    names = {name.lower(): name for name in CALLS}
    for match in CALL.finditer(text):
        name, line = names[match[1].lower()], bisect.bisect(ends, match.start()) + 1
        place = f"{path}, line {line}: {name}"
        words = [word.strip() for word in match[2].split(",")]
        if match[3] != ")" or len(words) not in CALLS[name]:
            counts, shown = (
                " or ".join(map(str, CALLS[name])),
                " ".join(match[2].split()),
            )
            raise ValueError(
                f"{place}({shown:.100} .., expected {counts} arguments, each a number "
                "or a variable"
            )
        values = [_value(place, word, variables) for word in words]
        call = Call(line, tuple(values[at] for at in FIELDS[name]))
        numbers = range(1)
        if name == "ChirpConfig":
            numbers = chirp_range(place, values[:2])
        elif name == "ProfileConfig":
            numbers = [whole(f"{place}: its number", values[0])]
        for number in numbers:
            yield name, number, call


def _value(place: str, word: str, variables: dict[str, set[str]]) -> float:
    """Return the number that an argument stands for; errors begin with `place`."""
    given = variables.get(word, {word})
    if len(given) > 1:
        shown = ", ".join(sorted(given)[:3])
        raise ValueError(
            f"{place}: {word} is set to several values ({shown:.80}), expected one: "
            "write the number that was used"
        )
    (text,) = given
    if not NUMBER.fullmatch(text):
        shown = word if text == word else f"{word} = {text}"
        raise ValueError(
            f"{place}: {shown!r:.80} is neither a number nor a variable set to one: "
            "write the number that was used"
        )
    value = float(int(text, 16)) if "x" in text.lower() else float(text)
    if not abs(value) <= LARGEST:
        raise ValueError(f"{place}: {text:.80}, expected at most {LARGEST:g}")
    return value


def _board(path, text: str, device: str | None) -> tuple[str, tuple[str, ...]]:
    """Return the board, and a note if it had to be assumed."""
    if device is not None:
        board_of(device)
        return device, ()
    for chip in reversed(CHIP.findall(text)):
        digits = re.sub(r"\D", "", chip)
        boards = [name for name in BOARDS if len(digits) == 4 and digits in name]
        if len(boards) > 1:
            raise UsageError(
                f"{path}: {chip} is on several boards, name one with --device: "
                f"{', '.join(boards)}"
            )
        if boards:
            return boards[0], ()
    return DEFAULT_BOARD, (
        f"{Path(path).name} names no chip that is known (SelectChipVersion): its "
        f"antennas are taken for those of the {DEFAULT_BOARD}, --device names another",
    )


def _sample_order(path, call: Call, board: str) -> str:
    """Return the order of I and Q; ValueError if the board has no such samples."""
    kind, swapped = (int(value) & 0xFFFF for value in call.values[-2:])
    if kind not in (COMPLEX, COMPLEX_2X):
        raise ValueError(
            f"{path}, line {call.line}: ChanNAdcConfig selects format {kind}, expected "
            f"complex samples ({COMPLEX})"
        )
    if kind == COMPLEX_2X:
        warnings.warn(
            f"{path}: complex 2x samples: the upper half of the range bins is the "
            "image band, not range",
            stacklevel=4,
        )
    orders = ("I4Q4", "Q4I4") if board == "awr1443" else ("IIQQ", "QQII")
    return orders[bool(swapped)]


def _check_stream(path, call: Call | None) -> None:
    if call is None:
        return
    interface, content = (int(value) & 0xFF for value in call.values)
    if interface != LVDS or content != SAMPLES_ONLY:
        raise ValueError(
            f"{path}, line {call.line}: DataPathConfig sends content {content} over "
            f"interface {interface}, expected samples alone over LVDS: set it to "
            "(513, 1216644097, 0) and record again"
        )


def _mask(flags) -> int:
    return sum(1 << bit for bit, on in enumerate(flags) if int(on) & 0xFFFF)
