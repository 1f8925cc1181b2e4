"""Stanford's PLY files: the vertices with all their properties, in any encoding.

A text header lists elements (vertex, face, ..) and their properties; the rows follow in
the same order. The vertices come first, and hold numbers without lists, as in the files
of all programs that write clouds. Errors are ValueError, KeyError or IndexError;
`read_cloud` adds the file's name.
"""

import numpy as np

from jradar.recordings.clouds.pcd import MAX_HEADER, binary_points, text_points

TYPES = {
    **{"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"},
    **{"uchar": "u1", "ushort": "u2", "uint": "u4", "float32": "f4", "float64": "f8"},
    **{"int8": "i1", "int16": "i2", "int32": "i4"},
    **{"uint8": "u1", "uint16": "u2", "uint32": "u4"},
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(content: bytes) -> dict[str, np.ndarray]:
    """Return the columns of the vertices."""
    end = content.find(b"end_header", 0, MAX_HEADER)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or not start:
        raise ValueError("no header from `ply` to `end_header`")
    order, elements = _header(content[:end].decode("ascii", "replace"))
    name, count, properties = elements[0]
    if name != "vertex" or any(kind[0] == "list" for kind, _ in properties):
        raise ValueError("expected vertices without lists as the first element")
    vertex = np.dtype([(name, order + TYPES[kind[0]]) for kind, name in properties])
    if not order:
        return text_points(content, start, vertex, count, more=len(elements) > 1)
    columns = binary_points(content, start, vertex, count)
    return {k: v.astype(v.dtype.newbyteorder("=")) for k, v in columns.items()}


def _header(text: str) -> tuple[str, list[tuple[str, int, list]]]:
    """Return the byte order (empty for text); name, rows, properties of elements."""
    order, elements = None, []
    for line in text.splitlines():
        match line.split():
            case ["format", form, *_]:
                order = ORDERS[form]
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", *kind, name]:
                elements[-1][2].append((kind, name))
    if order is None:
        raise ValueError("no line `format`")
    return order, elements
