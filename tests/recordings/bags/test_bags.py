"""Bags in three containers: clouds of every layout come back; stamps; damaged files."""

import concurrent.futures
import itertools
import shutil
import struct

import numpy as np
import pytest

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="pip install 'jradar[ros]'")

from jradar.recordings.bags import bags, unpacking  # noqa: E402
from jradar.recordings.bags.bags import bag_topics, open_bag  # noqa: E402
from tests.programs import finished  # noqa: E402
from tests.recordings.bag_writer import (  # noqa: E402
    CLOUD,
    CONTAINERS,
    LIVOX,
    START,
    STORES,
    TENTH,
    columns,
    files_of,
    livox,
    livox_bag,
    livox_rows,
    point_cloud2,
    write_bag,
)

EXTRA = {"offset_time": 0, "reflectivity": 4, "tag": 5, "line": 6}


@pytest.mark.parametrize(
    ("container", "frame"),
    [
        ("sqlite", "livox_frame"),
        *itertools.product(("bag", "mcap"), ("", "l", "abcd", "livox_frame")),
    ],  # padding follows the frame's name
)
def test_livox_clouds_come_back(tmp_path, container, frame):
    clouds = [livox_rows(n, n) for n in (5, 0, 1, 200)]
    stamps = [START + i * TENTH for i in range(4)]
    messages = [
        ("/livox/lidar", LIVOX, t + 999, livox(rows, t, frame))
        for rows, t in zip(clouds, stamps, strict=True)
    ]
    path = write_bag(tmp_path, container, messages)
    assert bag_topics(path) == {"/livox/lidar": (LIVOX, 4)}
    stream = open_bag(path)
    np.testing.assert_array_equal(stream.stamps, np.array(stamps) / 1e9)
    for i, rows in reversed([*enumerate(clouds)]):
        expected = np.array(rows).reshape(-1, 7)
        assert stream[i].dtype == np.float32
        np.testing.assert_array_equal(stream[i], expected[:, 1:5].astype(np.float32))
        points = stream.read_points(i)
        for name, column in EXTRA.items():
            np.testing.assert_array_equal(points[name], expected[:, column])
    assert stream.notes == ()


@pytest.mark.parametrize(
    ("container", "layout"),
    [
        ("sqlite", {}),
        *itertools.product(
            ("bag", "mcap"),
            ({}, {"gap": 0}, {"big": True}, {"height": 4}, {"height": 4, "row_gap": 9}),
        ),
    ],
    ids=str,
)
def test_point_clouds_of_any_layout_come_back(tmp_path, container, layout):
    wanted = columns(24)
    cloud = point_cloud2(wanted, START, **layout)
    path = write_bag(tmp_path, container, [("/points", CLOUD, START, cloud)])
    stream = open_bag(path)
    expected = [wanted[name] for name in ("x", "y", "z", "intensity")]
    np.testing.assert_array_equal(stream[0], np.stack(expected, -1).astype("f4"))
    points = stream.read_points(0)
    for name, column in wanted.items():
        np.testing.assert_array_equal(points[name], column)


def test_bytes_of_both_serialisations_written_by_hand(tmp_path):
    """The layout of formats.md, without any library's serialiser."""
    rows = livox_rows(3)
    points = [struct.pack("<IfffBBB", *row) for row in rows]
    tail = struct.pack("<QIB3xI", 5, 3, 1, 3)
    ros1 = struct.pack("<IIII", 1, 20, 30, 3) + b"abc" + tail + b"".join(points)
    cdr = b"\0\1\0\0" + struct.pack("<iII", 20, 30, 4) + b"abc\0" + tail
    cdr += b"\0".join(points)
    for container, raw in (("bag", ros1), ("mcap", cdr)):
        message = ("/l", LIVOX, START, lambda _, raw=raw: raw)
        stream = open_bag(write_bag(tmp_path, container, [message]))
        np.testing.assert_array_equal(stream[0], np.array(rows, "f4")[:, 1:5])
        assert stream.stamps.tolist() == [20 + 30e-9]


@pytest.mark.parametrize("container", CONTAINERS)
def test_bag_that_was_replaced_is_read_anew(tmp_path, container):
    for count in (3, 5):
        written = livox_bag(tmp_path / str(count), container, [livox_rows(count)])
        path = tmp_path / written.name
        shutil.rmtree(path, ignore_errors=True)
        path.unlink(missing_ok=True)
        written.rename(path)
        assert len(open_bag(path)[0]) == count


@pytest.mark.parametrize("container", CONTAINERS)
def test_threads_share_a_bag(tmp_path, container):
    clouds = [livox_rows(50 + seed, seed) for seed in range(12)]
    stream = open_bag(livox_bag(tmp_path, container, clouds, step=1))
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        read = [*pool.map(stream.__getitem__, [*range(12)] * 5)]
    for i, cloud in enumerate(read):
        np.testing.assert_array_equal(cloud, np.array(clouds[i % 12], "f4")[:, 1:5])


def test_missing_returns_are_left_out(tmp_path):
    rows = livox_rows(6)
    rows[1] = (0, 0.0, 0.0, 0.0, 9, 9, 9)
    rows[3] = (0, float("nan"), 1.0, 1.0, 9, 9, 9)
    rows[4] = (0, 1.0, float("inf"), 1.0, 9, 9, 9)
    path = livox_bag(tmp_path, "bag", [rows])
    expected = np.array([rows[i] for i in (0, 2, 5)], "f4")[:, 1:5]
    np.testing.assert_array_equal(open_bag(path)[0], expected)


def test_compressed_bag_with_several_topics_and_equal_times(tmp_path):
    clouds = [livox_rows(4, seed) for seed in range(6)]
    made = [livox(rows, START + i * TENTH) for i, rows in enumerate(clouds)]
    messages = [("/l", LIVOX, START + i // 3, one) for i, one in enumerate(made)]
    messages.insert(2, ("/p", CLOUD, START, point_cloud2(columns(2), START)))
    path = write_bag(tmp_path, "bag", messages, compressed="lz4")
    with pytest.raises(ValueError, match="2 topics of clouds, name one of /l, /p"):
        open_bag(path)
    with pytest.raises(ValueError, match="no clouds on /imu, name one of /l"):
        open_bag(path, topic="/imu")
    stream = open_bag(path, topic="/l")
    for i in (4, 0, 5, 2, 1, 3):
        np.testing.assert_array_equal(stream[i], np.array(clouds[i], "f4")[:, 1:5])


PACKED = [("bag", "bz2"), ("bag", "lz4"), ("sqlite", "message"), ("sqlite", "file")]


@pytest.mark.parametrize(("container", "compressed"), [*PACKED, ("mcap", "storage")])
def test_a_bag_that_unpacks_to_too_much(tmp_path, monkeypatch, container, compressed):
    rows = livox_rows(2000)
    path = livox_bag(tmp_path, container, [rows], compressed=compressed)
    np.testing.assert_array_equal(open_bag(path)[0], np.array(rows, "f4")[:, 1:5])
    for name in ("MOST_BYTES", "LEAST_LIMIT"):
        monkeypatch.setattr(unpacking, name, 10_000)
    monkeypatch.setattr(unpacking, "MOST_RATIO", 0)
    bags._reader.cache_clear()
    with pytest.raises(ValueError, match="not a whole bag .*unpacks to more than 10,0"):
        open_bag(path)[0]


UNCHANGED = """
import importlib, pkgutil, rosbags
modules = [
    importlib.import_module(found.name)
    for found in pkgutil.walk_packages(rosbags.__path__, "rosbags.")
    if not found.name.endswith("__main__")
]
def state():
    for module in modules:
        for name, value in vars(module).items():
            yield module.__name__, name, value
            inside = vars(value) if isinstance(value, type) else value
            if isinstance(inside, dict) or isinstance(value, type):
                yield from ((module.__name__, name, *pair) for pair in inside.items())
before = [*state()]
from jradar.recordings.bags.bags import open_bag
for path in {paths!r}:
    assert len(open_bag(path)[0])
after = [*state()]
assert len(before) > 1000 and len(before) == len(after)
for one, other in zip(before, after, strict=True):
    assert one[:-1] == other[:-1] and one[-1] is other[-1], one
"""


def test_opening_a_bag_leaves_rosbags_as_it_was(tmp_path):
    """Also in a program that reads bags with it."""
    paths = [
        str(livox_bag(tmp_path / f"{i}", container, [livox_rows(20)], compressed=how))
        for i, (container, how) in enumerate([*PACKED, ("mcap", "storage")])
    ]
    done = finished(UNCHANGED.format(paths=paths))
    assert done.returncode == 0, done.stderr


BAG_TIMES = [START / 1e9, START / 1e9 + 0.1, START / 1e9 + 0.2]


@pytest.mark.parametrize(
    ("headers", "stamps", "note"),
    [
        ((5, 0, 7), BAG_TIMES, "stamps in the headers are zero"),
        ((5, 7, 6), BAG_TIMES, "stamps in the headers are not rising"),
        ((123,), [123.0], "1,699,999,877.000 s behind"),  # another clock
    ],
)
def test_bad_header_stamps_give_way_to_the_bags_times(tmp_path, headers, stamps, note):
    messages = [
        ("/l", LIVOX, START + i * TENTH, livox(livox_rows(1), 10**9 * stamp))
        for i, stamp in enumerate(headers)
    ]
    stream = open_bag(write_bag(tmp_path, "mcap", messages))
    np.testing.assert_allclose(stream.stamps, stamps, rtol=0, atol=1e-6)
    assert note in stream.notes[0]


@pytest.mark.parametrize("container", CONTAINERS)
@pytest.mark.parametrize("keep", [0.0, 0.5, 0.999])
def test_truncated_bags_name_the_repair(tmp_path, container, keep):
    path = livox_bag(tmp_path, container, [livox_rows(3000)])
    [file] = files_of(path)
    content = file.read_bytes()
    file.write_bytes(content[: int(keep * len(content))])
    repair = {"bag": "rosbag reindex", "sqlite": "reindex", "mcap": "mcap recover"}
    with pytest.raises(ValueError, match=f"is not a whole bag.*{repair[container]}"):
        open_bag(path)[0]


@pytest.mark.parametrize("container", ["bag", "mcap"])
def test_messages_cut_or_lying_are_refused(tmp_path, container):
    store = STORES[container]
    serialize = store.serialize_ros1 if container == "bag" else store.serialize_cdr
    whole = bytes(serialize(livox(livox_rows(10), START)(store), LIVOX))
    lying = whole.replace(b"\0\0\0\n\0\0\0", b"\0\0\0" + b"\xff" * 4)
    assert lying != whole
    parts = [*(whole[:n] for n in range(0, len(whole), 5)), lying]
    made = [lambda _, part=part: part for part in parts]
    messages = [("/livox/lidar", LIVOX, START + i, one) for i, one in enumerate(made)]
    stream = open_bag(write_bag(tmp_path, container, messages))
    for i in range(len(stream)):
        with pytest.raises(ValueError, match=f"message {i} of /livox/lidar"):
            stream[i]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: setattr(m, "width", 2**32 - 1), "1 x 4294967295 points"),
        (lambda m: setattr(m.fields[0], "datatype", 11), "unknown type 11"),
        (lambda m: setattr(m.fields[2], "name", "u"), "expected x, y and z"),
        (lambda m: setattr(m.fields[2], "count", 3), "x holds 3 numbers a point"),
    ],
)
def test_point_clouds_that_lie_are_refused(tmp_path, change, message):
    def lying(store):
        cloud = point_cloud2(columns(4), START)(store)
        change(cloud)
        return cloud

    stream = open_bag(write_bag(tmp_path, "sqlite", [("/p", CLOUD, START, lying)]))
    with pytest.raises(ValueError, match=f"message 0 of /p: .*{message}"):
        stream[0]


@pytest.mark.parametrize("kind", ["[]", "{a: 1}", "3", "null", "&a [*a]"])
def test_types_of_topics_that_are_no_names_are_refused(tmp_path, kind):
    path = livox_bag(tmp_path, "sqlite", [livox_rows(4)])
    text = (path / "metadata.yaml").read_text()
    assert f"type: {LIVOX}" in text
    text = text.replace(f"type: {LIVOX}", f"type: {kind}")
    (path / "metadata.yaml").write_text(text)
    with pytest.raises(ValueError, match="is not a whole bag|0 topics of clouds"):
        open_bag(path)


def test_other_files_and_times_that_no_clock_has_are_refused(tmp_path):
    cloud = point_cloud2(columns(4), START)
    path = write_bag(tmp_path, "mcap", [("/p", CLOUD, 2**64 - 2, cloud)])
    with pytest.raises(ValueError, match="is not a whole bag .*has the time 1844"):
        open_bag(path)
    with pytest.raises(FileNotFoundError, match="no such bag"):
        open_bag(tmp_path / "a.bag")
    (tmp_path / "a.txt").write_text("hello")
    with pytest.raises(ValueError, match="not a whole bag"):
        open_bag(tmp_path / "a.txt")
    with pytest.raises(ValueError, match="not a whole bag.*metadata"):
        open_bag(tmp_path)
