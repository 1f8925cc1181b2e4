"""A format: which paths it covers and how they are read.

Three lists of formats drive this room, and `read` serves them all:

    open.READERS                  radar frames              -> Recording
    descriptions.DESCRIPTIONS     a radar's configuration   -> Description
    describe.CONTENTS             bags and clouds           -> what they hold

A new format is one file with a function that reads it, and one entry in a list.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jradar.errors import UsageError


class Format(NamedTuple):
    """One kind of file or folder."""

    name: str  # in error messages, such as "a .npy cube with its .toml"
    matches: Callable[[Path], bool]
    open: Callable[..., Any]
    options: tuple[str, ...] = ()  # that `open` takes after the path


def has_suffix(*suffixes: str) -> Callable[[Path], bool]:
    """Return a test for paths that end in one of `suffixes`."""
    return lambda path: path.suffix in suffixes


def read(
    path: Path, formats: Sequence[Format], options: Mapping[str, Any] | None = None
) -> Any:
    """Read `path` by the first of `formats` that matches it.

    Options that are None count as not given. Raises UsageError if no format matches,
    and for an option that the matching format does not take.
    """
    for found in formats:
        if found.matches(path):
            break
    else:
        names = "; ".join(known.name for known in formats)
        raise UsageError(f"{path} is of no known format, expected {names}")
    given = {k: v for k, v in (options or {}).items() if v is not None}
    for option, value in given.items():
        if option not in found.options:
            takers = [known.name for known in formats if option in known.options]
            raise UsageError(
                f"{option} = {value!r} does not apply to {path}, {found.name}; it is "
                f"an option of {'; '.join(takers) or 'no format'}: leave it out"
            )
    return found.open(path, **given)
