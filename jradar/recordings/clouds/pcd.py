"""PCD files of the Point Cloud Library: ascii, binary, and binary compressed by LZF.

A text header lists the fields with their types and sizes. A compressed file stores one
field after the other. `POINTS` is the number of points: some writers leave WIDTH and
HEIGHT at 0.
"""

import struct
from pathlib import Path

import numpy as np

MAX_HEADER = 64 << 10
TYPES = ("F4", "F8", "I1", "I2", "I4", "I8", "U1", "U2", "U4", "U8")
LEAST_TEXT = 2  # bytes of a number in text: a digit and a space
LONGEST_TEXT = 64  # bytes of a number in text; a table takes this for each


def read_pcd(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a PCD file; ValueError if they do not fit its header."""
    with path.open("rb") as file:
        fields, start = _header(path, file.read(MAX_HEADER))
    try:
        point = np.dtype([*_fields(fields)])
        if "POINTS" in fields:
            (count,) = map(int, fields["POINTS"])
        else:
            (width,), (height,) = fields["WIDTH"], fields["HEIGHT"]
            count = int(width) * int(height)
        (encoding,) = fields["DATA"]
        read = {"ascii": _text, "binary": _plain, "binary_compressed": _packed}
        if count < 0 or encoding not in read:
            raise ValueError(f"POINTS {count}, DATA {encoding}")
    except (KeyError, ValueError, TypeError) as error:
        raise ValueError(f"{path}: damaged PCD header: {error}") from error
    columns = read[encoding](path, start, point, count)
    return {name: column for name, column in columns.items() if name[0] != "_"}


def columns_of_words(
    path: Path, words: list[bytes], point: np.dtype
) -> dict[str, np.ndarray]:
    """Return the columns of points written as words; ValueError for other words."""
    if (longest := max(map(len, words), default=0)) > LONGEST_TEXT:
        raise ValueError(
            f"{path} holds a number of {longest:,} characters, expected at most "
            f"{LONGEST_TEXT}: damaged?"
        )
    table = np.array(words, "S").reshape(-1, max(point.itemsize and _width(point), 1))
    columns, at = {}, 0
    for name in point.names or ():
        kind = point[name]
        width = kind.shape[0] if kind.shape else 1
        try:
            column = table[:, at : at + width].astype(kind.base)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"{path}: {name}: {error}") from error
        columns[name] = column if kind.shape else column[:, 0]
        at += width
    return columns


def need(path: Path, start: int, count: int, size: int) -> None:
    """Raise ValueError if a file ends before `count` points of `size` bytes."""
    if (left := path.stat().st_size - start) < count * size:
        raise ValueError(
            f"{path} holds {left:,} bytes of points, its header claims {count:,} "
            f"points of {size} bytes: truncated or damaged"
        )


def _width(point):
    return sum(point[name].shape[0] if point[name].shape else 1 for name in point.names)


def _header(path, begin):
    """Return the header's lines, words by first word, and its length in bytes."""
    fields, start = {}, 0
    while "DATA" not in fields:
        end = begin.find(b"\n", start)
        if end < 0:
            raise ValueError(f"{path}: no DATA line, expected a PCD file's header")
        words = begin[start:end].decode("ascii", "replace").split("#")[0].split()
        start = end + 1
        if words:
            fields[words[0].upper()] = words[1:]
    return fields, start


def _fields(fields):
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


def _plain(path, start, point, count):
    need(path, start, count, point.itemsize)
    table = np.fromfile(path, point, count, offset=start)
    return {name: table[name] for name in point.names}


def _text(path, start, point, count):
    width = _width(point)
    need(path, start, count, LEAST_TEXT * width - 1)
    words = path.read_bytes()[start:].split()
    if len(words) != count * width:
        raise ValueError(
            f"{path} holds {len(words):,} numbers, {count:,} points of {width} need "
            f"{count * width:,}: truncated?"
        )
    return columns_of_words(path, words, point)


def _packed(path, start, point, count):
    data = path.read_bytes()[start:]
    size = count * point.itemsize
    if not count:
        return {name: np.zeros(0, point)[name] for name in point.names}
    if len(data) < 8:
        raise ValueError(f"{path} ends before its points: truncated?")
    packed, unpacked = struct.unpack_from("<II", data)
    if unpacked != size or packed > len(data) - 8:
        raise ValueError(
            f"{path}: {packed:,} packed bytes of {len(data) - 8:,} in the file become "
            f"{unpacked:,}, {count:,} points need {size:,}: truncated or damaged"
        )
    try:
        raw = lzf_decompress(data[8 : 8 + packed], size)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    columns = {}
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
