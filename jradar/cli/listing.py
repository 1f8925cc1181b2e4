"""The result of a command as indented lines, with tables in columns."""

from collections.abc import Iterator
from typing import Any

from jradar.errors import printable

SECONDS_SINCE_1970 = 1e8  # larger numbers are times


def lines(value: dict[str, Any], *, indent: str = "") -> Iterator[str]:
    """Yield the lines of a dictionary; empty and missing values are left out.

    Values can be nested dictionaries, lists, and lists of dictionaries with equal keys,
    which become tables. Control characters in texts are escaped.
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
    """Yield the lines of a table, from dictionaries with the same keys."""
    cells = [[*rows[0]], *([_short(v) for v in row.values()] for row in rows)]
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
