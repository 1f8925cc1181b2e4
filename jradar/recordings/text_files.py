"""Small text files: read with a size limit, as TOML, as a radar."""

import difflib
import tomllib
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from jradar.errors import UsageError
from jradar.radar import RadarSpec

MAX_BYTES = 4 << 20  # the largest description, a cascade's coupling, takes 0.5 MB


def read_text(path: Path | str, *, errors: str = "strict") -> str:
    """Return the text of a small file; ValueError if it is large or binary.

    `errors="replace"` is for formats whose comments may use another encoding.
    """
    path = Path(path)
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, expected at most {MAX_BYTES:,}")
    try:
        return path.read_text(encoding="utf-8-sig", errors=errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file: {error.reason}") from error


def toml(path: Path | str) -> dict[str, Any]:
    """Return the tables of a TOML file; UsageError for a syntax error."""
    try:
        return tomllib.loads(read_text(path))
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path} is not valid TOML: {error}") from error


def check_names(
    path: Path | str, what: str, given: Iterable[str], names: Collection[str]
) -> None:
    """Raise UsageError for the first unknown name, with the nearest known one."""
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(str(name), names, 1) or [", ".join(names)]
            raise UsageError(f"{path}: unknown {what} {name!r}, expected {near[0]}")


def radar_of(path: Path | str, values: dict[str, Any]) -> RadarSpec:
    """Return the radar with these fields; errors name the file they come from."""
    try:
        return RadarSpec.from_dict(values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def radar_from_toml(path: Path | str) -> RadarSpec:
    """Return the radar in the `[radar]` table of a TOML file; UsageError if wrong."""
    try:
        return RadarSpec.from_dict(toml(path).get("radar", {}))
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from error
