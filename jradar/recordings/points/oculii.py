"""Packet traces of Oculii's Eagle, which are refused by their name.

Their payloads begin as TI's serial packets do, and go on otherwise.
"""

from pathlib import Path
from typing import NoReturn

from jradar.errors import UsageError
from jradar.files import open_file
from jradar.recordings.points.ti_stream import MAGIC
from jradar.recordings.recording import Format

BEGIN_BYTES = 64 << 10
SUFFIXES = (".pcap", ".pcapng", ".cap")


def refuse_oculii(
    path: Path,
    description: Path | str | None = None,
    *,
    iq_order: str | None = None,
    device: str | None = None,
) -> NoReturn:
    """Raise UsageError, which says what works."""
    raise UsageError(
        f"{path} holds packets of an Oculii Eagle, which are not read: write its "
        "decoded points as a .csv with names of columns, x, y, z, doppler, frame"
    )


def is_oculii(path: Path) -> bool:
    """True for a trace whose first packets begin as TI's serial ones do."""
    if path.suffix not in SUFFIXES or not path.is_file():
        return False
    with open_file(path) as file:
        return MAGIC in file.read(BEGIN_BYTES)


READER = Format(
    "packets of an Oculii Eagle, which are refused",
    is_oculii,
    refuse_oculii,
    ("description", "iq_order", "device"),
)
