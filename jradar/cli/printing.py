"""What commands print: results as lines or JSON, errors as one line."""

import argparse
import difflib
import json
import math
import re
import sys
from collections.abc import Iterator
from typing import Any, NoReturn

from jradar.errors import printable
from jradar.files import DISK_FULL

SECONDS_SINCE_1970 = 1e8  # larger numbers are times
SYMBOLS = {"m/s": "mps", "/": " per ", "%": " percent ", "'": ""}  # in keys of JSON


class Results(dict[str, Any]):
    """What a command prints, and its exit code."""

    code = 0


def say(text: str) -> None:
    """Print a line on stderr, with control characters escaped."""
    line = " ".join(text.split())
    sys.stderr.write(f"jradar: {printable(line)}\n")


def in_words(error: BaseException) -> str:
    """Return the text of an error; errors of the system begin with their file."""
    if isinstance(error, OSError) and error.errno and error.filename:
        reason = "disk full" if error.errno in DISK_FULL else error.strerror
        return f"{error.filename}: {reason}"
    if isinstance(error, KeyboardInterrupt) and not str(error):
        return "interrupted"
    return str(error) or type(error).__name__


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the nearest known word."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and end with code 2."""
        wrong = message.removeprefix("unrecognized arguments: ").split()[0]
        known: list[str] = []
        if wrong.startswith("-"):
            wrong, known = wrong.partition("=")[0], [*self.known_options()]
        elif found := re.search(
            r"invalid choice: '(.*)' \(choose from (.*)\)", message
        ):
            wrong, known = found[1], re.findall(r"[\w-]+", found[2])
        if wrong in known:
            takers = [
                k for k, p in self.commands().items() if wrong in p.known_options()
            ]
            every = len(takers) == len(self.commands())
            message += (
                f": it stands after {'the command' if every else ', '.join(takers)}"
            )
        elif near := difflib.get_close_matches(wrong, known, 1):
            message += f", did you mean {near[0]}?"
        line = printable(f"{self.prog}: {message} (see {self.prog} --help)")
        self.exit(2, f"{line}\n")

    def known_options(self) -> set[str]:
        """Return the options of this parser and of its commands."""
        known = {*self._option_string_actions}
        return known.union(*(p.known_options() for p in self.commands().values()))

    def commands(self) -> dict[str, "Parser"]:
        """Return the parsers of the commands by name."""
        choices = [action.choices for action in self._actions]
        return next((each for each in choices if isinstance(each, dict)), {})


def as_json(result: dict[str, Any]) -> str:
    """Return a result as JSON; numbers that are not finite become null.

    The names of the printed table become identifiers: `frames/s` is `frames_per_s`.
    """
    return json.dumps(_plain(result), indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {identifier(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def identifier(name: str) -> str:
    """Return a name in lower-case letters, digits and underscores."""
    for symbol, word in SYMBOLS.items():
        name = name.replace(symbol, word)
    return "_".join(re.findall("[a-z0-9]+", name.lower()))


def lines(value: dict[str, Any], *, indent: str = "") -> Iterator[str]:
    """Yield a result as indented lines; empty and missing values are left out.

    Values can be nested dictionaries, lists, and lists of dictionaries, which become
    tables. Control characters in texts are escaped.
    """
    for key, item in value.items():
        if isinstance(item, dict) and item:
            yield f"{indent}{key}"
            yield from lines(item, indent=indent + "  ")
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            yield f"{indent}{key}"
            yield from (f"{indent}  {line}" for line in _table(item))
        elif isinstance(item, list) and item and isinstance(item[0], str):
            yield f"{indent}{key}"
            yield from (f"{indent}  {_short(text)}" for text in item)
        elif item or item == 0:
            yield f"{indent}{key:<27} {_short(item)}"


def _table(rows):
    """Yield the lines of a table from dictionaries, with "-" for missing values."""
    names = [*dict.fromkeys(name for row in rows for name in row)]
    cells = [names, *([_short(row.get(name)) for name in names] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        yield "  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True))


def _short(value):
    """Return a value as text, numbers with about four digits, times with ms."""
    if isinstance(value, float) and abs(value) > SECONDS_SINCE_1970:
        return f"{value:.3f}"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1 else f"{value:.2f}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and value and isinstance(value[0], float):
        return "  ".join(f"{number:.4g}" for number in value)
    if value is None:
        return "-"
    items = value if isinstance(value, list) else [value]
    return printable(" x ".join(map(str, items)))
