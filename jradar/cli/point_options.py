"""The fields of `PointSpec` as options, read from its source.

Importing the class would load JAX, and `--help` would wait for it.
"""

import argparse
import ast
import functools
from pathlib import Path
from typing import Any, NamedTuple

from jradar.cli import values

SOURCE = Path(__file__).parents[1] / "radar" / "point_spec.py"
KINDS: dict[str, dict[str, Any]] = {  # by the annotation of a field
    "str": {"metavar": "NAME"},
    "int": {"metavar": "N", "type": functools.partial(values.whole, 0, 1 << 20)},
    "float": {"metavar": "X", "type": values.positive},
    "tuple[int, int]": {"metavar": "D,R", "type": values.cells},
}


class Field(NamedTuple):
    """A field of `PointSpec`."""

    name: str
    kind: str
    default: Any
    text: str


@functools.cache
def point_fields() -> tuple[Field, ...]:
    """Return the fields in their order, each with the help that stands below it."""
    module = ast.parse(SOURCE.read_text(encoding="utf-8"))
    (body,) = (n.body for n in module.body if isinstance(n, ast.ClassDef))
    found = []
    for field, below in zip(body, body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
            kind = ast.unparse(field.annotation).removesuffix(" | None")
            default = ast.literal_eval(ast.unparse(field.value or ast.Constant(None)))
            text = " ".join(ast.literal_eval(below.value).split())
            found.append(Field(ast.unparse(field.target), kind, default, text))
    return tuple(found)


def add_point_options(sub: argparse.ArgumentParser, *names: str) -> None:
    """Add an option for each field of `PointSpec`, or for those of these names."""
    for name, kind, default, text in point_fields():
        if names and name not in names:
            continue
        flag = "--" + name.replace("_", "-")
        if kind == "bool" and not default:
            sub.add_argument(
                flag, action="store_const", const=True, default=None, help=text
            )
        elif kind == "bool":
            optional = argparse.BooleanOptionalAction
            sub.add_argument(flag, action=optional, help=f"{text} (default: yes)")
        else:
            shown = str(default).strip("()").replace(", ", ",")
            text = text if default is None else f"{text} (default: {shown})"
            sub.add_argument(flag, help=text, **KINDS[kind])


def given_points(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields that the user gave."""
    found = {field.name: getattr(options, field.name, None) for field in point_fields()}
    return {name: value for name, value in found.items() if value is not None}
