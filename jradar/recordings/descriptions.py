"""Descriptions of a radar, of any kind in `DESCRIPTIONS`.

`--radar` names one; otherwise a reader finds the only one beside its file.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jradar.errors import UsageError
from jradar.radar import RadarSpec
from jradar.recordings.coloradar_calib import radar_from_coloradar
from jradar.recordings.recording import Format, read
from jradar.recordings.studio_log import radar_from_studio_log
from jradar.recordings.text_files import radar_from_toml
from jradar.recordings.ti_cfg import CaptureSpec, radar_from_cfg


class Description(NamedTuple):
    """A radar, and how a capture card stores its samples."""

    radar: RadarSpec
    capture: CaptureSpec = CaptureSpec()


def _read_cfg(path: Path, device: str = "awr1843") -> Description:
    radar = radar_from_cfg(path, device=device)
    return Description(radar, CaptureSpec.from_cfg(path, device=device))


DESCRIPTIONS = (
    Format(
        "a .toml with a [radar] table",
        lambda path: path.suffix == ".toml",
        lambda path: Description(radar_from_toml(path)),
    ),
    Format(
        "a .cfg of TI's mmWave SDK",
        lambda path: path.suffix == ".cfg",
        _read_cfg,
        ("device",),
    ),
    Format(
        "a log of mmWave Studio (.txt or .csv)",
        lambda path: path.suffix in (".txt", ".csv"),
        lambda path: Description(radar_from_studio_log(path)),
    ),
    Format(
        "a ColoRadar folder such as calib/single_chip",
        Path.is_dir,
        lambda path: Description(radar_from_coloradar(path)),
    ),
)


def read_description(path: Path | str, *, device: str | None = None) -> Description:
    """Return the radar that a file or folder describes.

    `device` is the board of a .cfg. Raises FileNotFoundError for a missing path, and
    UsageError for an unknown kind of file or a `device` that does not apply.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such radar description: {path}")
    return read(path, DESCRIPTIONS, device=device)


def find_description(path: Path, patterns: Sequence[str]) -> Path:
    """Return the only file beside `path` that matches one of `patterns`.

    Raises UsageError if there are several or none.
    """
    found = sorted({file for p in patterns for file in path.parent.glob(p)})
    if len(found) == 1:
        return found[0]
    names = f" ({', '.join(file.name for file in found[:5])})" if found else ""
    raise UsageError(
        f"{len(found) or 'no'} radar descriptions beside {path}{names}, expected one "
        f"of {', '.join(patterns)}: name the file with --radar"
    )
