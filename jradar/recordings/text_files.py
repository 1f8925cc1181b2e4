"""Small text files, read with a limit: descriptions of radars and captures."""

import tomllib
from pathlib import Path
from typing import Any

from jradar.radar import RadarSpec

MAX_BYTES = 4 << 20  # of a description; the largest, a cascade's coupling, holds 0.5 MB


def read_text(path: Path | str, errors: str = "strict") -> str:
    """The text of a small file; ValueError for a large or a binary one.

    `errors="replace"` is for formats whose comments may be in another encoding.
    """
    path = Path(path)
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, expected at most {MAX_BYTES:,}")
    try:
        return path.read_text(encoding="utf-8-sig", errors=errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file: {error.reason}") from error


def toml(path: Path | str) -> dict[str, Any]:
    """The tables of a TOML file."""
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path} is not valid TOML: {error}") from error


def radar_of(path: Path | str, values: dict[str, Any]) -> RadarSpec:
    """The radar with the fields read from a file, which an error names."""
    try:
        return RadarSpec.from_dict(values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def radar_from_toml(path: Path | str) -> RadarSpec:
    """The radar in the `[radar]` table of a TOML file (example in the README)."""
    return radar_of(path, toml(path).get("radar", {}))
