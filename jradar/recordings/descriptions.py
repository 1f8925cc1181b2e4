"""Descriptions of a radar, of any kind in `DESCRIPTIONS`.

`--radar` names one; otherwise a reader takes the one next to its file. `LOG.txt#2` is
the second configuration in a log of mmWave Studio.
"""

import logging
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.files import MAX_TEXT_BYTES
from jradar.options.sensor import RadarSpec
from jradar.recordings.coloradar.calib import radar_from_coloradar
from jradar.recordings.radar_toml import read_radar_toml
from jradar.recordings.recording import Format, read
from jradar.recordings.ti.cfg import read_cfg
from jradar.recordings.ti.frame import CaptureSpec
from jradar.recordings.ti.lua import read_lua
from jradar.recordings.ti.mmwave_json import read_mmwave_json
from jradar.recordings.ti.studio_log import read_studio_log

# What only the files of each kind contain that describe a radar.
SIGNS = {
    ".toml": b"[radar]",
    ".cfg": b"profileCfg",
    ".lua": b"ar1.ProfileConfig",
    ".json": b'"mmWaveDevices"',
    ".txt": b"API:ProfileConfig",
    ".csv": b"API:ProfileConfig",
}
LOG = logging.getLogger(__name__)
MOST_FRAMES = 10_000_000  # ten days of ten a second
CAPTURE_TOML = "capture.toml"  # describes a whole rig, and names the radar's file


class Description(NamedTuple):
    """A radar, how a capture card stores its samples, and warnings about both."""

    radar: RadarSpec
    capture: CaptureSpec = CaptureSpec()
    notes: tuple[str, ...] = ()


DESCRIPTIONS = (
    Format(
        "a .toml with a [radar] table",
        lambda path: path.suffix == ".toml",
        lambda path: Description(*read_radar_toml(path)),
    ),
    Format(
        "a .cfg of TI's mmWave SDK",
        lambda path: path.suffix == ".cfg",
        lambda path, **options: Description(*read_cfg(path, **options)),
        ("device",),
    ),
    Format(
        "a log of mmWave Studio (.txt or .csv)",
        lambda path: path.suffix in (".txt", ".csv"),
        lambda path, **options: Description(*read_studio_log(path, **options)),
        ("configuration",),
    ),
    Format(
        "a .lua script of mmWave Studio",
        lambda path: path.suffix == ".lua",
        lambda path, **options: Description(*read_lua(path, **options)),
        ("device",),
    ),
    Format(
        "an .mmwave.json of mmWave Studio",
        lambda path: path.suffix == ".json",
        lambda path, **options: Description(*read_mmwave_json(path, **options)),
        ("device",),
    ),
    Format(
        "a ColoRadar folder such as calib/single_chip",
        Path.is_dir,
        lambda path: Description(radar_from_coloradar(path)),
    ),
)


def is_description(path: Path | str) -> bool:
    """Return whether a file, or a configuration in a log, may describe a radar."""
    file = Path(str(path).partition("#")[0])
    if file.suffix not in SIGNS or not file.is_file():
        return False
    return file.suffix != ".csv" or _describes_radar(file)  # or a table of points


def read_description(path: Path | str, *, device: str | None = None) -> Description:
    """Return the radar that a file or folder describes.

    `device` is the board of a .cfg, .lua or .json. Raises FileNotFoundError for a
    missing path, and UsageError for an unknown kind of file, a `device` that does not
    apply and a configuration that a log does not hold.
    """
    path, number = Path(path), None
    numbered = re.fullmatch(r"(.+)#(\d{1,6})", path.name)
    if numbered and not path.exists():
        path, number = path.with_name(numbered[1]), int(numbered[2])
    if not path.exists():
        raise FileNotFoundError(f"no such radar description: {path}")
    found = read(path, DESCRIPTIONS, device=device, configuration=number)
    LOG.info("the radar, a %s, is described by %s", found.radar.name, path)
    return found


def frame_stamps(
    path: Path, count: int, period_s: float
) -> Float[np.ndarray, " frame"] | None:
    """Return the times of frames that follow one another; None for an unknown period.

    Raises ValueError for more frames than any recording has.
    """
    if count > MOST_FRAMES:
        raise ValueError(
            f"{path} holds {count:,} frames, expected at most {MOST_FRAMES:,}: does "
            "the description belong to another recording?"
        )
    return np.arange(count) * period_s if period_s else None


def find_description(path: Path, patterns: Sequence[str]) -> Path:
    """Return the file next to `path` that matches one of `patterns` and describes it.

    Of several files, those that describe no radar, such as logs of the capture card, do
    not count. Among those that do, the name decides: `run_1.bin` belongs to
    `run_1.cfg`, `run_1_LogFile.txt` and `LogFile_1.txt`. Raises UsageError if several
    or none are left.
    """
    found = sorted({file for p in patterns for file in path.parent.glob(p)})
    found = [file for file in found if file.is_file() and file.name != CAPTURE_TOML]
    if len(found) > 1:
        found = [file for file in found if _describes_radar(file)] or found
    if len(found) > 1:
        found = _of_same_name(path, found) or found
    if len(found) == 1:
        return found[0]
    names = f" ({', '.join(file.name for file in found[:5])})" if found else ""
    raise UsageError(
        f"{len(found) or 'no'} radar descriptions next to {path}{names}, expected one "
        f"of {', '.join(patterns)}: name the file with --radar"
    )


def _describes_radar(file: Path) -> bool:
    with file.open("rb") as content:
        return SIGNS.get(file.suffix, b"") in content.read(MAX_TEXT_BYTES)


def _of_same_name(path: Path, found: list[Path]) -> list[Path]:
    """Return the files that are named after a capture, or else bear its number."""
    stem = re.sub(r"_Raw_\d+$", "", path.stem)
    begin = re.compile(rf"{re.escape(stem)}([._](?!\d).*)")
    if named := [file for file in found if begin.fullmatch(file.name)]:
        return named
    number = re.search(r"_(\d+)$", stem)
    if number is None:
        return []
    end = re.compile(rf".*_0*{int(number[1])}")
    return [file for file in found if end.fullmatch(file.stem)]
