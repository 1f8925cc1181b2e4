"""PCD files of the Point Cloud Library: ascii, binary, and binary compressed by LZF.

A text header lists the fields with their types and sizes. A compressed file stores one
field after the other. `POINTS` is the number of points: some writers leave WIDTH and
HEIGHT at 0. Errors are ValueError or KeyError; `read_cloud` adds the file's name.
"""

import struct
from collections.abc import Iterator

import numpy as np

MAX_HEADER = 64 << 10
TYPES = ("F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8")
LEAST_TEXT = 2  # bytes of a number in text: a digit and a space
LONGEST_TEXT = 64  # bytes of a number in text; a table takes this for each


def read_pcd(content: bytes) -> dict[str, np.ndarray]:
    """Return the columns of a PCD file."""
    fields, start = _header(content)
    point = np.dtype([*_fields(fields)])
    if "POINTS" in fields:
        (count,) = map(int, fields["POINTS"])
    else:
        (width,), (height,) = fields["WIDTH"], fields["HEIGHT"]
        count = int(width) * int(height)
    (encoding,) = fields["DATA"]
    read = {
        "ascii": text_points,
        "binary": binary_points,
        "binary_compressed": _packed,
    }[encoding]
    columns = read(content, start, point, count)
    return {name: column for name, column in columns.items() if name[0] != "_"}


def text_points(
    content: bytes, start: int, point: np.dtype, count: int, *, more: bool = False
) -> dict[str, np.ndarray]:
    """Return the columns of points written as words, after which `more` may follow."""
    width = _width(point)
    need(content, start, count, LEAST_TEXT * width - 1)
    words = content[start:].split()
    if more:
        words = words[: count * width]
    if len(words) != count * width:
        raise ValueError(
            f"it holds {len(words):,} numbers, {count:,} points of {width} need "
            f"{count * width:,}: truncated?"
        )
    if (longest := max(map(len, words), default=0)) > LONGEST_TEXT:
        raise ValueError(
            f"a number of {longest:,} characters, expected at most {LONGEST_TEXT}"
        )
    table = np.array(words, "S").reshape(-1, max(width, 1))
    columns, at = {}, 0
    for name in point.names or ():
        kind = point[name]
        each = kind.shape[0] if kind.shape else 1
        try:
            column = table[:, at : at + each].astype(kind.base)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{name}: {error}") from error
        columns[name] = column if kind.shape else column[:, 0]
        at += each
    return columns


def need(content: bytes, start: int, count: int, size: int) -> None:
    """Raise ValueError if a file ends before `count` points of `size` bytes."""
    left = len(content) - start
    if count < 0 or left < count * size:
        raise ValueError(
            f"it holds {left:,} bytes of points, its header claims {count:,} points of "
            f"{size} bytes: truncated?"
        )


def _width(point: np.dtype) -> int:
    shapes = [point[name].shape for name in point.names or ()]
    return sum(shape[0] if shape else 1 for shape in shapes)


def _header(content: bytes) -> tuple[dict[str, list[str]], int]:
    """Return the header's lines, words by first word, and its length in bytes."""
    fields, start = {}, 0
    while "DATA" not in fields:
        end = content.find(b"\n", start, MAX_HEADER)
        if end < 0:
            raise ValueError("no DATA line")
        words = content[start:end].decode("ascii", "replace").split("#")[0].split()
        start = end + 1
        if words:
            fields[words[0].upper()] = words[1:]
    if missing := {"FIELDS", "TYPE", "SIZE"} - fields.keys():
        raise ValueError(f"its header lacks {', '.join(sorted(missing))}")
    return fields, start


def _fields(fields: dict[str, list[str]]) -> Iterator[tuple[str, str, tuple[int, ...]]]:
    """Yield name, format and shape of each field; padding gets names with `_`."""
    names = fields["FIELDS"]
    counts = fields.get("COUNT", ["1"] * len(names))
    columns = names, fields["TYPE"], fields["SIZE"], counts
    for at, (name, kind, size, count) in enumerate(zip(*columns, strict=True)):
        if kind + size not in TYPES or int(count) < 1:
            raise ValueError(f"field {name}: COUNT {count}, TYPE {kind}, SIZE {size}")
        form = f"<{kind.lower()}{size}"
        shape = (int(count),) if int(count) > 1 else ()
        yield f"_{at}" if name == "_" else name, form, shape


def binary_points(
    content: bytes, start: int, point: np.dtype, count: int
) -> dict[str, np.ndarray]:
    """Return the columns of points written one after another."""
    need(content, start, count, point.itemsize)
    table = np.frombuffer(content, point, count, start)
    return {name: table[name] for name in point.names or ()}


def _packed(content, start, point, count):
    size = count * point.itemsize
    if not count:
        return {name: np.zeros(0, point)[name] for name in point.names}
    packed, unpacked = struct.unpack_from("<II", content, start)
    data = content[start + 8 : start + 8 + packed]
    if unpacked != size or len(data) < packed:
        raise ValueError(
            f"{packed:,} packed bytes of {len(data):,} in the file become "
            f"{unpacked:,}, {count:,} points need {size:,}: truncated?"
        )
    raw, columns = lzf_decompress(data, size), {}
    for name in point.names:
        kind, at = point[name], point.fields[name][1] * count
        columns[name] = np.ndarray((count, *kind.shape), kind.base, raw, at)
    return columns


def lzf_decompress(data: bytes, size: int) -> bytes:
    """Return the `size` bytes packed by LZF; ValueError for damaged data.

    A control byte below 32 precedes literal bytes, one more than its value. Other
    control bytes hold a length in their upper 3 bits (7: one more byte follows) and a
    distance back in the lower 5 bits and the next byte.
    """
    out, at = bytearray(), 0
    try:
        while at < len(data) and len(out) < size:
            control = data[at]
            at += 1
            if control < 32:
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            begin = len(out) - ((control & 31) << 8 | data[at]) - 1
            at += 1
            if begin < 0:
                raise IndexError
            repeat = out[begin : begin + length + 2]
            while len(repeat) < length + 2:  # source and target overlap
                repeat = repeat + repeat
            out += repeat[: length + 2]
    except IndexError:
        raise ValueError("the packed points are damaged") from None
    if len(out) != size or at != len(data):
        raise ValueError(
            f"the packed points are damaged: {len(out):,} of {size:,} bytes"
        )
    return bytes(out)
