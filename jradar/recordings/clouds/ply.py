"""Stanford's PLY files: the vertices with all their properties, in any encoding.

A text header lists elements (vertex, face, ..) and their properties; the rows follow in
the same order. A list property is a count followed by its values. Errors are ValueError
or KeyError; `read_cloud` adds the file's name.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jradar.recordings.clouds.pcd import LEAST_TEXT, MAX_HEADER, columns_of_words, need

TYPES = {
    **{"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"},
    **{"uchar": "u1", "ushort": "u2", "uint": "u4", "float32": "f4", "float64": "f8"},
    **{"int8": "i1", "int16": "i2", "int32": "i4"},
    **{"uint8": "u1", "uint16": "u2", "uint32": "u4"},
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class Property(NamedTuple):
    """A number in each row; a list of numbers if `length`, the count's type, is set."""

    name: str
    type: str
    length: str = ""


class Element(NamedTuple):
    """A table of a PLY file."""

    name: str
    rows: int
    properties: list[Property]


def read_ply(content: bytes) -> dict[str, np.ndarray]:
    """Return the columns of the vertices, without lists."""
    end = content.find(b"end_header", 0, MAX_HEADER)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or not start:
        raise ValueError("no header from `ply` to `end_header`")
    order, elements = _header(content[:end].decode("ascii", "replace"))
    names = [element.name for element in elements]
    before = elements[: names.index("vertex") + 1]
    for element in before:  # each row takes at least `least` bytes
        least = LEAST_TEXT * len(element.properties) - 1
        if order:
            least = sum(
                np.dtype(p.length or p.type).itemsize for p in element.properties
            )
        need(content, start, element.rows, max(least, 1))
    if not order:
        return _text(content[start:].split(), before)
    columns = {}
    for element in before:
        columns, start = _rows(content, start, element, order)
    return columns


def _header(text):
    """Return the byte order (empty for text) and the elements."""
    order, elements = None, []
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = ORDERS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"]:
            _, _, length, kind, name = words
            elements[-1].properties.append(Property(name, TYPES[kind], TYPES[length]))
        elif words[:1] == ["property"]:
            _, kind, name = words
            elements[-1].properties.append(Property(name, TYPES[kind]))
    if order is None:
        raise ValueError("no line `format`")
    return order, elements


def _rows(content, start, element, order):
    """Return the columns of a binary element, and the start of the next element."""
    numbers = [p for p in element.properties if not p.length]
    row = np.dtype([(p.name, order + p.type) for p in numbers])
    if len(numbers) == len(element.properties):
        need(content, start, element.rows, row.itemsize)
        table = np.frombuffer(content, row, element.rows, start)
        start += element.rows * row.itemsize
    else:
        kept = bytearray()
        for entry in _entries(element):
            size = np.dtype(entry.type).itemsize
            if entry.length:
                form = np.dtype(order + entry.length)
                length = np.frombuffer(content[start : start + form.itemsize], form)
                start += form.itemsize
                size *= int(length.sum())  # 0 at the end of a truncated file
            else:
                kept += content[start : start + size]
            if size < 0 or start + size > len(content):
                raise ValueError(_cut(element))
            start += size
        table = np.frombuffer(bytes(kept), row) if numbers else np.zeros(0, row)
    table = table.astype(row.newbyteorder("="))
    return {name: table[name] for name in row.names or ()}, start


def _text(words, elements):
    """Return the columns of the last of `elements`, whose rows are words."""
    at, kept = 0, list[bytes]()
    for element in elements:
        kept.clear()
        for entry in _entries(element):
            if not entry.length:
                kept += words[at : at + 1]
            at += 1
            if entry.length and at <= len(words) and words[at - 1].isdigit():
                at += int(words[at - 1])
            elif entry.length or at > len(words):
                raise ValueError(_cut(element))
    numbers = [p for p in elements[-1].properties if not p.length]
    row = np.dtype([(p.name, p.type) for p in numbers])
    return columns_of_words(kept, row)


def _entries(element: Element) -> Iterator[Property]:
    return (entry for _ in range(element.rows) for entry in element.properties)


def _cut(element: Element) -> str:
    return f"the rows of {element.name} are damaged or truncated"
