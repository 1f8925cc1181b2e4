"""Values of files and of callers as the fields of a dataclass, of the right types."""

import dataclasses
import difflib
import functools
import math
import typing
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

Value = TypeVar("Value")
WORDS = {int: "an integer", float: "a number", bool: "true or false", str: "a text"}


def typed_fields(spec: Any, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of a file in the types of the fields of the dataclass `spec`.

    Lists become tuples, whole numbers become floats where floats are expected, and
    tables become specs, which keep the defaults of `spec` for what they leave out.
    Raises ValueError for an unknown field, for another type, and for NaN and infinity.
    """
    kinds = typing.get_type_hints(spec)
    names = [field.name for field in dataclasses.fields(spec)]
    fields = {}
    for name, value in values.items():
        if name not in names:
            near = difflib.get_close_matches(str(name), names, 1) or [", ".join(names)]
            raise ValueError(f"unknown field {name!r}, expected {near[0]}")
        if dataclasses.is_dataclass(kinds[name]) and isinstance(value, dict):
            typed = typed_fields(kinds[name], value)
            make: Callable[..., Any] = kinds[name]
            default: Any = getattr(spec, name, None)  # has what the table leaves out
            if isinstance(default, kinds[name]):
                make = functools.partial(dataclasses.replace, default)
            fields[name] = make(**typed)
            continue
        try:
            fields[name] = _converted(value, kinds[name])
        except (TypeError, OverflowError) as error:
            expected = _named(kinds[name])
            text = f"{name} = {value!r:.80}, expected {expected}"
            raise ValueError(text) from error
    return fields


def option(default: Value, text: str) -> Value:
    """Return a dataclass's field with a default, and the help of its option."""
    return dataclasses.field(default=default, metadata={"help": text})


def _converted(value: Any, kind: Any) -> Any:
    """Return a value as `kind`, the annotation of a field; TypeError if it is not."""
    choices = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        if not isinstance(value, list | tuple):
            raise TypeError
        if choices[-1] is ...:
            choices = choices[:1] * len(value)
        if len(value) != len(choices):
            raise TypeError
        return tuple(map(_converted, value, choices))
    if choices:  # such as float | None
        if value is None and type(None) in choices:
            return None
        return _converted(value, choices[0])
    if kind is float and type(value) in (int, float):
        if not math.isfinite(number := float(value)):
            raise TypeError
        return number
    if dataclasses.is_dataclass(kind) or (kind in WORDS and type(value) is not kind):
        raise TypeError
    return value


def _named(kind: Any, *, one: bool = True) -> str:
    """Return words for the annotation of a field: of one value, or of several."""
    choices = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        count = "" if choices[-1] is ... else f"{len(choices)} "
        lists = f"{count}{_named(choices[0], one=False)}"
        return f"a list of {lists}" if one else f"lists of {lists}"
    words = WORDS.get(choices[0] if choices else kind, "a table")
    return words if one else f"{words.split()[-1]}s"
