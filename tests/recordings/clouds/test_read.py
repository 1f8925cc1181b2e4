"""PCD, PLY, KITTI clouds written byte by byte; truncated, lying, empty, real ones."""

import math
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st

from jradar.recordings.clouds.pcd import lzf_decompress
from jradar.recordings.clouds.read import read_cloud

ROWS = [  # x y z timestamp intensity ring tags[2]
    (1.5, -2.25, 0.125, 1700000000.25, 200, 40000, -3, 7),
    (float("nan"), 0.0, 0.0, 1700000000.5, 0, 0, 0, 0),
    (0.0, 0.0, 0.0, 0.0, 255, 65535, -128, 127),
]
PCD = """\
# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z _ timestamp intensity ring tags
SIZE 4 4 4 1 8 1 2 1
TYPE F F F U F U U I
COUNT 1 1 1 3 1 1 1 2
WIDTH 0
HEIGHT 0
VIEWPOINT 0 0 0 1 0 0 0
POINTS {points}
DATA {data}
"""
NAMES = ["x", "y", "z", "timestamp", "intensity", "ring", "tags"]


def pcd(data, rows=ROWS, points=None):
    """A PCD file of the encoding `data`."""
    head = PCD.format(points=len(rows) if points is None else points, data=data)
    if data == "ascii":
        lines = [[*row[:3], 0, 0, 0, *row[3:]] for row in rows]
        body = "".join(" ".join(map(str, line)) + "\n" for line in lines).encode()
    elif data == "binary":
        body = b"".join(struct.pack("<fff3xdBHbb", *row) for row in rows)
    else:
        columns = [*zip(*rows, strict=True)] if rows else [()] * 8
        padding = [(0,) * 3 * len(rows)]
        tags = [tuple(v for row in rows for v in row[6:])]
        parts = columns[:3] + padding + columns[3:6] + tags
        raw = b"".join(
            struct.pack(f"<{len(part)}{code}", *part)
            for part, code in zip(parts, "fffBdBHb", strict=True)
        )
        packed = lzf_compress(raw)
        body = struct.pack("<II", len(packed), len(raw)) + packed
    return head.encode() + body


def lzf_compress(raw):
    """Greedy LZF: the longest match of all places behind, else a literal."""
    out, literals, at = bytearray(), bytearray(), 0
    while at < len(raw):
        for length in range(min(264, len(raw) - at), 2, -1):
            part = raw[at : at + length]
            if (place := raw.rfind(part, max(at - 8192, 0), at + length - 1)) >= 0:
                break
        else:
            length, place = 1, -1
            literals.append(raw[at])
        at += length
        if literals and (place >= 0 or len(literals) == 32 or at == len(raw)):
            out += bytes([len(literals) - 1]) + literals
            literals.clear()
        if place >= 0:
            high, low = divmod(at - length - place - 1, 256)
            more = [min(length - 2, 7) << 5 | high, length - 9][: 1 + (length > 8)]
            out += bytes([*more, low])
    return bytes(out)


def save(folder, name, content):
    (folder / name).write_bytes(content)
    return folder / name


DATA = ["ascii", "binary", "binary_compressed"]


@pytest.mark.parametrize("data", DATA)
def test_pcd_of_mixed_types(tmp_path, data):
    columns = read_cloud(save(tmp_path, "a.pcd", pcd(data)))
    assert [*columns] == NAMES
    forms = ["f4", "f4", "f4", "f8", "u1", "u2", "i1"]
    assert [column.dtype for column in columns.values()] == [*map(np.dtype, forms)]
    assert columns["tags"].shape == (3, 2)
    for i, row in enumerate(ROWS):
        values = [columns[name][i] for name in NAMES[:6]] + [*columns["tags"][i]]
        np.testing.assert_array_equal(np.array(values, float), np.array(row))
    columns = read_cloud(save(tmp_path, "a.pcd", pcd(data, rows=[])))
    assert [*columns] == NAMES and columns["x"].shape == (0,)


@pytest.mark.parametrize("data", DATA)
def test_pcd_cut_anywhere_or_lying_is_refused(tmp_path, data):
    whole = pcd(data)
    shortest = len(whole) - (3 if data == "ascii" else 1)  # "127" cut is a number too
    for cut in range(0, shortest, 5):
        with pytest.raises(ValueError, match=r"a\.pcd"):
            read_cloud(save(tmp_path, "a.pcd", whole[:cut]))
    for points in (10**12, 2**62, -1, "many", "3 3"):
        with pytest.raises(ValueError, match="a.pcd.*(claims|need|damaged)"):
            read_cloud(save(tmp_path, "a.pcd", pcd(data, points=points)))


def test_pcd_without_points_line_counts_width_times_height(tmp_path):
    content = pcd("binary").replace(b"POINTS 3\n", b"")
    content = content.replace(b"WIDTH 0", b"WIDTH 3").replace(b"HEIGHT 0", b"HEIGHT 1")
    assert len(read_cloud(save(tmp_path, "a.pcd", content))["x"]) == 3
    for line in (b"HEIGHT", b"HEIGHT 1 1"):
        bad = content.replace(b"HEIGHT 1", line)
        with pytest.raises(ValueError, match="a.pcd is damaged or not"):
            read_cloud(save(tmp_path, "a.pcd", bad))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    st.lists(st.sampled_from([b"\0", b"ab", b"abcabcabd", b"\xff" * 40]), max_size=12),
    st.binary(max_size=40),
)
def test_lzf_against_a_compressor(parts, noise):
    raw = b"".join(parts) + noise + b"".join(parts[::2])
    packed = lzf_compress(raw)
    assert lzf_decompress(packed, len(raw)) == raw
    for cut in range(len(packed)):
        with pytest.raises(ValueError, match="damaged"):
            lzf_decompress(packed[:cut], len(raw))


def test_lzf_never_exceeds_its_size_nor_reaches_before_its_start():
    bomb = bytes([0, 65]) + bytes([7 << 5, 255, 0]) * 1000  # 264 bytes from 3
    for packed, size in ((bomb, 300), (bytes([0, 65, 1 << 5, 5]), 4)):
        with pytest.raises(ValueError, match="damaged"):
            lzf_decompress(packed, size)


PLY = [  # x y z (f4), time (f8), ring (u2), class (i1), and a list before class
    (1.5, -2.25, 0.125, 1700000000.25, 40000, [1, 2, 3], -5),
    (float("nan"), 0.0, 0.0, 0.5, 0, [], 5),
    (0.0, 0.0, 0.0, -1.0, 65535, [7], 127),
]


def ply(form, lists=False, before=False, count=None):
    """A PLY file, with a list among the properties, or with faces before vertices."""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    count = len(PLY) if count is None else count
    head = ["ply", f"format {form} 1.0", "comment end", "obj_info made by hand"]
    faces = ["element face 2", "property list uchar int vertex_indices"]
    head += faces if before else []
    head += [f"element vertex {count}"]
    head += [f"property float {name}" for name in "xyz"]
    head += ["property float64 time", "property ushort ring"]
    head += ["property list uint8 int16 seen"] if lists else []
    head += ["property char class", *([] if before else faces), "end_header\n"]
    body = b""
    for x, y, z, time, ring, seen, kind in PLY:
        values = [x, y, z, time, ring, *([len(seen), *seen] if lists else []), kind]
        codes = f"fffdH{f'B{len(seen)}h' if lists else ''}b"
        if order:
            body += struct.pack(order + codes, *values)
        else:
            body += (" ".join(map(str, values)) + "\n").encode()
    rows = b""
    for face in ((3, 0, 1, 2), (4, 0, 1, 2, 0)):
        line = " ".join(map(str, face)) + "\n"
        packed = struct.pack(f"{order}B{len(face) - 1}i", *face)
        rows += packed if order else line.encode()
    return "\n".join(head).encode() + (rows + body if before else body + rows)


EMPTY = b"FIELDS\nSIZE\nTYPE\nPOINTS 5\nDATA %s\n"
FACES = b"""ply
format binary_little_endian 1.0
element face 1
property list int int i
element vertex 0
property float x
end_header
"""
FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("form", FORMS)
def test_ply_with_extra_properties(tmp_path, form):
    columns = read_cloud(save(tmp_path, "a.ply", ply(form)))
    assert [*columns] == ["x", "y", "z", "time", "ring", "class"]
    kinds = [c.dtype.str[1:] for c in columns.values()]
    assert kinds == ["f4", "f4", "f4", "f8", "u2", "i1"]
    for i, row in enumerate(PLY):
        values = [float(column[i]) for column in columns.values()]
        np.testing.assert_array_equal(values, [*row[:5], row[6]])


@pytest.mark.parametrize("form", FORMS)
def test_ply_cut_anywhere_or_lying_is_refused(tmp_path, form):
    whole = ply(form)
    end = whole.rindex(b" 0 1 2 0\n") - 12 if form == "ascii" else len(whole) - 30
    for cut in range(0, end - 4, 5):
        with pytest.raises(ValueError, match=r"a\.ply"):
            read_cloud(save(tmp_path, "a.ply", whole[:cut]))
    for count in (10**12, 2**63, -1, "many"):
        with pytest.raises(ValueError, match="a.ply.*(claims|damaged)"):
            read_cloud(save(tmp_path, "a.ply", ply(form, count=count)))
    twice = whole.replace(b"float y", b"float x")
    with pytest.raises(ValueError, match="a.ply is damaged .*more than once"):
        read_cloud(save(tmp_path, "a.ply", twice))


def with_first(content, word):
    """An ascii file with another word as its first number."""
    end = content.index(b"DATA ascii\n" if b"DATA" in content else b"end_header\n") + 11
    first = content[end:].split()[0]
    return content[:end] + content[end:].replace(first, word, 1)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        *(
            ("a.ply", ply("ascii").replace(b"40000", word), "a.ply is .*: ring: ")
            for word in (b"70000", b"-1", b"1.5", b"word")
        ),
        ("a.pcd", pcd("ascii").replace(b"40000", b"70000"), "a.pcd is .*: ring: "),
        *(
            (f"a.{kind}", with_first(made("ascii"), word), f"of {len(word):,} charac")
            for kind, made in (("pcd", pcd), ("ply", ply))
            for word in (b"1" * 60_000, b"0." + b"1" * 100)
        ),  # before a table of such widths is made
        *(
            ("a.ply", content, "expected vertices without lists as the first element")
            for content in (ply("ascii", lists=True), ply("ascii", before=True), FACES)
        ),
        ("a.pcd", pcd("binary").replace(b"SIZE", b"SIZES"), "its header lacks SIZE"),
        *(
            ("a.pcd", EMPTY % data, r"a\.pcd is damaged or not")
            for data in (b"ascii", b"binary", b"binary_compressed")
        ),  # points without fields
        ("a.ply", FACES.replace(b"property list int int i", b"") + b"0", "a.ply is"),
        ("a.txt", b"", "not a cloud, expected .pcd, .ply, .bin"),
        ("a.pcd", pcd("binary").replace(b"x y z", b"u v w"), "expected x, y and z"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_numbers_lists_and_files_that_do_not_fit(tmp_path, name, content, message):
    with pytest.raises(ValueError, match=message):
        read_cloud(save(tmp_path, name, content))


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_ply_of_another_writer(tmp_path, encoding):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    content = mesh.export(file_type="ply", encoding=encoding.split("_")[0])
    columns = read_cloud(save(tmp_path, "a.ply", content))
    read = np.stack([columns[name] for name in "xyz"], -1)
    np.testing.assert_allclose(read, mesh.vertices, atol=1e-6)


def test_kitti_bin(tmp_path):
    rows = [(1.0, 2.0, 3.0, 0.5), (math.nan, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.25)]
    content = b"".join(struct.pack("<4f", *row) for row in rows)
    columns = read_cloud(save(tmp_path, "a.bin", content))
    np.testing.assert_array_equal(np.stack([*columns.values()], -1), rows)
    assert read_cloud(save(tmp_path, "b.bin", b""))["x"].shape == (0,)
    with pytest.raises(ValueError, match="holds 47 bytes, expected a multiple of 16"):
        read_cloud(save(tmp_path, "a.bin", content[:-1]))
    with pytest.raises(FileNotFoundError, match="no such cloud"):
        read_cloud(tmp_path / "a.ply")


@pytest.mark.parametrize("count", [8, 7])  # 80 bytes fit four columns, too
def test_nuscenes_bin_has_five_columns(tmp_path, count):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.normal(size=(count, 4)), np.arange(count) % 32])
    columns = read_cloud(save(tmp_path, "a.bin", points.astype("<f4").tobytes()))
    assert [*columns] == ["x", "y", "z", "intensity", "ring"]
    np.testing.assert_array_equal(columns["ring"], points[:, 4])
    np.testing.assert_allclose(columns["z"], points[:, 2], rtol=1e-6)
    kitti = rng.normal(size=(20, 4)).astype("<f4")  # 320 bytes fit five columns, too
    columns = read_cloud(save(tmp_path, "b.bin", kitti.tobytes()))
    np.testing.assert_array_equal(np.stack([*columns.values()], -1), kitti)


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("livox/scene2_1_10.pcd", 240_887),
        ("pcd/000000.pcd", 240_000),
        ("ply/target.ply", 69_088),
        ("kitti/000000.bin", 124_668),
        ("kitti/000001.bin", 124_605),
        ("ouster/os1_64_as_coloradar_lidar.bin", 16_749),
    ],
)
def test_real_clouds(samples, name, count):
    columns = read_cloud(samples / name)
    assert {len(column) for column in columns.values()} == {count}
    xyz = np.stack([columns[k] for k in "xyz"], -1).astype(float)
    assert np.isfinite(xyz).all() and np.abs(xyz).max() < 300
    ranges = np.linalg.norm(xyz, axis=1)
    if name.startswith("ply"):
        assert 4_500 < (ranges == 0).sum() < 5_500
    if name.startswith("ouster"):
        elevation = np.degrees(np.arcsin((xyz[:, 2] / ranges)[ranges > 0]))
        assert -17 < elevation.min() < -15 and 15 < elevation.max() < 20
    if name.startswith("kitti"):
        ground = xyz[(ranges > 5) & (ranges < 15) & (xyz[:, 2] < -1.2), 2]
        assert np.median(ground) == pytest.approx(-1.7, abs=0.15)
    if name.startswith("pcd"):
        assert columns["ring"].max() == 127
