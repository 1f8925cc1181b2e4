"""Radar in a log of TI's mmWave Studio.

    API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,256,10000,0,0,30,0,

Each line holds a command and its arguments in register units. A repeated command
replaces the earlier one (a profile or chirp: the one of the same number). What is in
force at a FrameConfig or a SensorStart is one configuration; a log of several captures
holds several.
"""

from collections.abc import Iterator
from pathlib import Path

from jradar.errors import UsageError
from jradar.files import read_text
from jradar.options.boards import BOARDS
from jradar.options.sensor import RadarSpec
from jradar.recordings.ti.frame import (
    CaptureSpec,
    Chirp,
    bits,
    chirp_range,
    radar_of_frame,
)

# Register units of mmWave Studio (TI mmWave Link interface control document).
FREQUENCY_GHZ = 3.6 / 2**26
SLOPE_MHZ_PER_US = 3.6e3 * 900 / 2**26
TIME_US = 0.01
FRAME_PERIOD_S = 5e-9
UNITS = (FREQUENCY_GHZ, TIME_US, TIME_US, TIME_US, SLOPE_MHZ_PER_US, 1, 1)
# The places of the fields that are read; a log ends every command with its result, 0.
PLACES = {
    "select_chip_version": [0],
    "ChannelConfig": [1],  # the mask of receivers
    "AdcOutConfig": [1],  # 0 for real samples
    # number; start, idle, ADC start, ramp end, slope, samples, rate
    "ProfileConfig": [0, 1, 2, 3, 4, 7, 9, 10],
    # first and last; profile, 4 variations, transmitters as a mask or as flags
    "ChirpConfig": [*range(8)],
    "FrameConfig": [0, 1, 3, 4],  # first and last chirp, turns, period
    "LaneConfig": [0],  # the mask of LVDS lanes
}
OPTIONAL = {"LaneConfig"}
NUMBERS = {"ProfileConfig": 1, "ChirpConfig": 2}  # leading fields that name the object
ENDS = ("FrameConfig", "SensorStart")  # of a configuration
MOST_SHOWN = 5  # configurations in a note
LARGEST = 2**32  # a register has at most 32 bits
CHIPS = {board.studio_chip: name for name, board in BOARDS.items() if board.studio_chip}

Configuration = dict[str, dict[tuple, tuple]]  # of each command and number: the fields


def read_studio_log(
    path: Path | str, *, configuration: int | None = None
) -> tuple[RadarSpec, CaptureSpec, tuple[str, ...]]:
    """Return the radar in the log that mmWave Studio writes next to `adc_data.bin`.

    Of several configurations, counted from 1, the last is taken by default, and a note
    lists the last ones. Raises UsageError for a number that the log does not hold, and
    errors as `radar_of_frame`.
    """
    count = sum(1 for _ in _replay(path))
    taken = count if configuration is None else configuration
    if not 1 <= taken <= count:
        raise UsageError(f"{path} has no configuration {taken}, expected 1 to {count}")
    radars: dict[int, RadarSpec | ValueError] = {}
    lanes: dict[int, int] = {}
    for number, now in enumerate(_replay(path), 1):
        if number == taken or number > count - MOST_SHOWN:
            (mask,) = now.get("LaneConfig", {}).get((), (0,))
            lanes[number] = int(mask).bit_count()
            try:
                radars[number] = _radar(path, now)
            except ValueError as error:
                radars[number] = error
    if isinstance(radar := radars[taken], ValueError):
        raise radar
    capture = CaptureSpec(lanes=lanes[taken])
    if count == 1:
        return radar, capture, ()
    shown = (n for n in sorted(radars) if n > count - MOST_SHOWN)
    sizes = "; ".join(f"#{number} {_size(radars[number])}" for number in shown)
    note = (
        f"{Path(path).name} holds {count} configurations (tx x rx x chirps x samples, "
        f"range bin, frame period: {sizes}); #{taken} was taken, --radar {path}#1 "
        "names another"
    )
    return radar, capture, (note,)


def _size(radar: RadarSpec | ValueError) -> str:
    """Return size of a frame, range bin and period of one configuration."""
    if isinstance(radar, ValueError):
        return "unusable"
    size = " x ".join(map(str, radar.cube_shape))
    return f"{size}, {radar.range_resolution_m:.3g} m, {radar.frame_period_s:g} s"


def _radar(path: Path | str, chosen: Configuration) -> RadarSpec:
    (chip,), (rx_mask,), (adc_format,), (*ends, turns, period) = (
        chosen[name][()]
        for name in ("select_chip_version", "ChannelConfig", "AdcOutConfig", ENDS[0])
    )
    if chip not in CHIPS:
        raise ValueError(f"{path}: chip {chip}, expected one of {', '.join(CHIPS)}")
    if adc_format <= 0:
        raise ValueError(f"{path}: real samples were recorded, expected complex ones")
    profiles, chirps = {}, {}
    for (profile,), registers in chosen["ProfileConfig"].items():
        profiles[profile] = [r * u for r, u in zip(registers, UNITS, strict=True)]
    for (first, last), (profile, *others) in chosen["ChirpConfig"].items():
        chirp = Chirp(profile, others[:4], _transmitters(path, *others[4:]))
        chirps |= dict.fromkeys(range(first, last + 1), chirp)
    radar, _, _ = radar_of_frame(
        path,
        CHIPS[chip],
        profiles=profiles,
        chirps=chirps,
        ends=ends,
        turns=turns,
        period_s=period * FRAME_PERIOD_S,
        rx_mask=rx_mask,
    )
    return radar


def _replay(path: Path | str) -> Iterator[Configuration]:
    """Yield each complete configuration; the object changes with the next line."""
    now, changed, found = Configuration(), False, 0
    text = read_text(path, errors="replace")
    for number, line in enumerate(text.splitlines(), 1):
        name, _, rest = line.partition("API:")[2].partition(",")
        if name in PLACES:
            place = f"{path}, line {number}: {line!r:.120}"
            fields = _fields(name, rest.rstrip(",").split(","), place)
            named, kept = NUMBERS.get(name, 0), now.setdefault(name, {})
            changed |= kept.pop(fields[:named], None) != fields[named:]
            kept[fields[:named]] = fields[named:]  # the latest stands last
        if name in ENDS and changed and PLACES.keys() - OPTIONAL <= now.keys():
            changed, found = False, found + 1
            yield now
    needed = [name for name in PLACES if name not in OPTIONAL]
    missing = [name for name in needed if name not in now]
    if missing == needed:
        begin = text.lstrip().partition("\n")[0]
        raise ValueError(
            f"{path} is a text that begins with {begin!r:.60}, not a log of mmWave "
            "Studio, in which lines hold API:ProfileConfig and others"
        )
    if missing:
        raise ValueError(
            f"{path} is a log of mmWave Studio without {', '.join(missing)}: send all "
            "of them to the radar in one session, and take its whole log"
        )
    if not found:
        yield now


def _fields(name: str, words: list[str], place: str) -> tuple:
    """Return the fields of a command that are read; errors begin with `place`."""
    if name == "select_chip_version":
        return tuple(words[:1])
    try:
        numbers = [int(word) for word in words]
    except ValueError:
        numbers = []
    least = max(PLACES[name]) + 1
    if len(numbers) < least or max(map(abs, numbers)) > LARGEST:
        raise ValueError(
            f"{place}, expected {least} or more register values after {name}"
        )
    if name == "ChirpConfig":
        chirp_range(place, numbers[:2])
        return tuple(numbers)
    return tuple(numbers[at] for at in PLACES[name])


def _transmitters(path: Path | str, mask: int, *flags: int) -> list[int]:
    """Return the transmitters of a chirp, given as a mask, or by a flag of each.

    After a mask only the result follows, which is 0.
    """
    if any(flags):
        return [tx for tx, on in enumerate((mask, *flags)) if on]
    return bits(path, mask)
