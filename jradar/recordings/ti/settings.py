"""Settings of a DCA1000 capture card, in the `cf.json` of TI's command line.

    DCA1000Config
      dataLoggingMode    "raw": samples only; "multi": kinds of data in separate files
      lvdsMode           1: four lanes (xWR12xx, 14xx), 2: two lanes
      dataFormatMode     1: 12 bits, 2: 14 bits, 3: 16 bits
      dataFormatConfig   reorderEnable 1: IIQQ is stored as IQIQ

They describe the stream, not the radar. A `.setup.json` of mmWave Studio holds a part.
"""

from pathlib import Path
from typing import Any

from jradar.files import read_json
from jradar.recordings.ti.iq_order import OTHER_INTERLEAVE, TWO_LANES

MAX_BYTES = 1 << 20
MOST_FILES = 20  # that are looked at
BITS = {1: 12, 2: 14}


def card_notes(capture: Path, *, order: str, decided: bool) -> list[str]:
    """Return what the settings beside a capture say against reading it as `order`.

    `decided` tells that the spectra confirm the order or that the user named it; then
    only what cannot be mended by another order is reported. Settings that are damaged
    or ambiguous, because several files hold some, are ignored.
    """
    files = sorted(capture.parent.glob("*.json"))[:MOST_FILES]
    found = {file: read_settings(file) for file in files}
    known = {file: settings for file, settings in found.items() if settings}
    if len(known) != 1:
        return []
    [(file, settings)] = known.items()
    notes = []
    if settings.get("dataLoggingMode") == "multi":
        notes.append("dataLoggingMode is multi, expected raw")
    if bits := BITS.get(_plain(settings.get("dataFormatMode")) or 0):
        notes.append(f"the samples have {bits} bits")
    stream = settings.get("dataFormatConfig")
    reorders = isinstance(stream, dict) and _plain(stream.get("reorderEnable")) == 1
    four_lanes = _plain(settings.get("lvdsMode")) == 1
    other = None
    if four_lanes and order in TWO_LANES:
        other = "I4Q4" if order.startswith("I") else "Q4I4"
    elif reorders and order in ("IIQQ", "QQII"):
        other = OTHER_INTERLEAVE[order]
    if other and not decided:
        why = "lvdsMode 1" if four_lanes else "reorderEnable 1"
        notes.append(
            f"{why} suggests the order {other}, the samples were read as {order}: try "
            f"--iq-order {other} if echoes are mirrored"
        )
    return [f"{file.name}: {note}" for note in notes]


def read_settings(path: Path) -> dict[str, Any]:
    """Return the settings of the card in a JSON file; {} if it holds none."""
    try:
        settings = read_json(path, limit=MAX_BYTES).get("DCA1000Config")
    except (OSError, ValueError):
        return {}
    return settings if isinstance(settings, dict) else {}


def _plain(value: Any) -> int | None:
    """Return a whole number as it is, anything else as None."""
    return value if isinstance(value, int) else None
