"""Records: frames are read as written; damage and unfinished folders are refused."""

import dataclasses
import errno
import json

import jax
import numpy as np
import pytest

from jradar.data.records import (
    FORMAT,
    Records,
    finished_shard,
    from_bytes,
    to_bytes,
    write_shard,
)
from jradar.lidar import LidarSpec
from jradar.radar import RadarSpec
from tests.data.prepared import invented_frame

ABOUT = {"options_sha256": "abc"}


def write_folder(folder, complete=True):
    """Two sequences of two shards each."""
    sequences = []
    for name, split in (("run0", "train"), ("run1", "test")):
        shards = []
        for block in range(2):
            frames = (invented_frame(4 * block + i, name) for i in range(4))
            path = folder / name / f"{block:04d}.array_record"
            shards.append(write_shard(path, frames, ABOUT, {}))
        sequences.append({"name": name, "split": split, "shards": shards})
    manifest = {
        "format": FORMAT,
        "complete": complete,
        "radar": dataclasses.asdict(RadarSpec.awr1843()),
        "options": {"lidar": dataclasses.asdict(LidarSpec())},
        "sequences": sequences,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("records"))


def assert_same(found, wanted):
    assert (found.sequence, found.frame) == (wanted.sequence, wanted.frame)
    assert (found.stamp, found.lidar_stamp) == (wanted.stamp, wanted.lidar_stamp)
    np.testing.assert_array_equal(found.world_from_radar, wanted.world_from_radar)
    jax.tree.map(np.testing.assert_array_equal, found.radar, wanted.radar)
    np.testing.assert_array_equal(found.lidar_xyz, wanted.lidar_xyz)
    np.testing.assert_array_equal(found.cells.power, wanted.cells.power)
    np.testing.assert_allclose(found.cells.azimuth, wanted.cells.azimuth, atol=1e-3)


def test_a_record_holds_the_frame_and_the_folds_of_its_cells():
    for points in (0, 500):
        frame = invented_frame(3, lidar_points=points)
        found = from_bytes(to_bytes(frame))
        assert_same(found, frame)
        assert found.cells.fold is None
    fold = np.arange(128, dtype=np.int32).reshape(8, 16) % 3 - 1
    cells = frame.cells._replace(fold=fold, fold_margin_db=np.abs(frame.cells.azimuth))
    found = from_bytes(to_bytes(frame._replace(cells=cells))).cells
    np.testing.assert_array_equal(found.fold, fold)
    np.testing.assert_array_equal(found.fold_margin_db, cells.fold_margin_db)


def test_frames_are_read_in_any_order(folder):
    records = Records(folder)
    assert len(records) == 16
    assert_same(records[13], invented_frame(5, "run1"))
    assert_same(records[2], invented_frame(2, "run0"))
    assert records.where[13] == ("run1", 5)
    assert_same(records[-1], invented_frame(7, "run1"))
    with pytest.raises(IndexError, match="item 16 of a stream of 16"):
        records[16]


def test_splits_are_apart(folder):
    test = Records(folder, "test")
    assert {name for name, _ in test.where} == {"run1"} and len(test) == 8
    assert test.radar == RadarSpec.awr1843()
    assert test.digest != Records(folder, "train").digest
    with pytest.raises(ValueError, match="validation.*'test', 'train'"):
        Records(folder, "validation")


def flip_a_bit(path, place):
    content = bytearray(path.read_bytes())
    content[int(place * len(content))] ^= 1
    path.write_bytes(content)


def test_unfinished_folders_and_truncated_or_damaged_shards_are_refused(tmp_path):
    path = write_folder(tmp_path, complete=False) / "run1/0001.array_record"
    with pytest.raises(ValueError, match="run the same `jradar prepare` again"):
        Records(tmp_path)
    whole = write_folder(tmp_path).joinpath(path).read_bytes()
    flip_a_bit(path, 0.5)  # the header of a block
    with pytest.raises(ValueError, match="damaged shard"):
        Records(tmp_path)
    path.write_bytes(whole[:-1])
    with pytest.raises(ValueError, match="run1/0001.array_record holds .* truncated"):
        Records(tmp_path)


def test_a_flipped_bit_is_found(tmp_path):
    path = write_folder(tmp_path) / "run1/0001.array_record"
    flip_a_bit(path, 0.03)
    records = Records(tmp_path)
    with pytest.raises(ValueError, match="run1/0001.* does not match its digest"):
        records.verify()
    damaged = 0
    for i in range(len(records)):
        try:
            assert_same(records[i], invented_frame(*records.where[i][::-1]))
        except ValueError as error:
            damaged += 1
            assert f"record {i} (run1, frame " in str(error)
    assert damaged == 1


@pytest.mark.parametrize("text", ["", "[]", "{", '{"format": 99}', "\xff"])
def test_a_damaged_manifest_is_refused(tmp_path, text):
    (tmp_path / "manifest.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError, match=r"manifest.json|format"):
        Records(tmp_path)


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("sequences", 0, "shards", 0, "file"), "/etc/passwd", "names '/etc/passwd'"),
        (("sequences", 0, "shards", 0, "file"), "../x", "without `..`"),
        (("sequences", 0, "shards", 0, "file"), 3, "file is 3, expected str"),
        (("sequences", 0, "shards", 0, "bytes"), "many", "bytes is 'many'"),
        (("sequences", 0, "shards", 0, "frames"), 4, "frames is 4, expected list"),
        (("sequences", 0, "shards", 0, "frames"), [0], "holds 16 frames, its manifest"),
        (("sequences", 0, "shards", 0), [], "damaged or not a manifest"),
        (("sequences", 0, "split"), ["train"], "split is"),
        (("sequences", 0), "run0", "damaged or not a manifest"),
        (("sequences",), 3, "damaged or not a manifest"),
        (("options",), [], "damaged or not a manifest"),
        (("options", "lidar"), {"azimuth": 3}, "azimuth = 3, expected a list of 2"),
        (("radar",), "awr1843", "damaged or not a manifest"),
        (("radar", "num_samples"), 1e3, "num_samples = 1000.0, expected an integer"),
    ],
)
def test_a_manifest_with_wrong_values_is_refused(tmp_path, place, value, message):
    path = write_folder(tmp_path) / "manifest.json"
    manifest = inner = json.loads(path.read_text())
    for step in place[:-1]:
        inner = inner[step]
    inner[place[-1]] = value
    path.write_text(json.dumps(manifest))
    with pytest.raises(ValueError, match=message):
        Records(tmp_path)


def test_a_full_disk_is_an_error_of_the_system_and_leaves_nothing(small_disk):
    frames = (invented_frame(i, points=1024, lidar_points=5000) for i in range(99))
    path = small_disk / "run0" / "0000.array_record"
    with pytest.raises(OSError, match="No space left on device.*0000.array") as error:
        write_shard(path, frames, ABOUT, {})
    assert error.value.errno == errno.ENOSPC
    assert not [*path.parent.iterdir()]


@pytest.mark.parametrize("fault", [ValueError("frame 1 is cut"), RuntimeError("other")])
def test_other_errors_are_passed_on_and_leave_nothing(tmp_path, fault):
    def frames():
        yield invented_frame(0)
        raise fault

    path = tmp_path / "run0" / "0000.array_record"
    with pytest.raises(type(fault), match=str(fault)):
        write_shard(path, frames(), ABOUT, {})
    assert not [*path.parent.iterdir()]


def test_finished_shards_are_recognised_by_content_and_options(tmp_path):
    path = tmp_path / "run0" / "0000.array_record"
    assert finished_shard(path, ABOUT) is None
    frames = [invented_frame(0), invented_frame(1)]
    written = write_shard(path, iter(frames), ABOUT, {})
    assert finished_shard(path, ABOUT) == written and written["frames"] == [0, 1]
    assert finished_shard(path, {"options_sha256": "other"}) is None
    path.write_bytes(path.read_bytes() + b"x")
    assert finished_shard(path, ABOUT) is None
