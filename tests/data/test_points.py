"""Recordings of the points that a radar sent become records, without cells."""

import jax
import numpy as np
import pytest

from jradar.data import Records, cells_of, describe_manifest, prepare
from jradar.data.frames import NO_PLACE, prepare_frame
from jradar.errors import UsageError
from jradar.recordings import open_recording
from tests.data.prepared import SPEC
from tests.recordings import bag_writer
from tests.recordings.points.astyx_writer import AWAY, SIZES, write_astyx
from tests.recordings.small_sequence import PILLAR, room_scan, write_sequence

WALL, BOTH = ("wall",), ("wall", "pillar")


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walks")
    return write_astyx(folder / "walk.npz", [WALL, BOTH, (), BOTH])


@pytest.fixture(scope="module")
def manifest(walk, tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    return folder, prepare(walk, folder, SPEC, workers=1)


def test_records_hold_the_points_that_the_radar_sent(walk, manifest):
    records, recording = Records(manifest[0], "train"), open_recording(walk)
    assert records.of_points and records.radar is None and not records.other_radars
    assert records.where == [("walk", 0), ("walk", 1), ("walk", 3)]
    count = len(AWAY) + sum(SIZES.values())
    for frame in (records[1], records[2]):
        sent = recording.frames[frame.frame]
        assert frame.cells is None and frame.radar.xyz.shape == (1024, 3)
        assert frame.radar.valid[:count].all() and not frame.radar.valid[count:].any()
        for name in ("xyz", "velocity", "power"):
            found = getattr(frame.radar, name)[:count]
            np.testing.assert_array_equal(found, getattr(sent, name))
        assert np.isnan(frame.world_from_radar).all() and frame.range_bias_m == 0
        made, *_ = prepare_frame(recording, frame.frame, frame.frame, SPEC)
        jax.tree.map(np.testing.assert_array_equal, frame.radar, made.radar)
        np.testing.assert_array_equal(frame.lidar_xyz, made.lidar_xyz)
        assert frame.stamp == frame.lidar_stamp == made.stamp
    records.verify()


def test_a_frame_without_points_is_dropped_and_counted(manifest):
    found = describe_manifest(manifest[1])
    reason = "the radar sent no points"
    assert found["dropped"] == [{"sequence": "walk", "frames": 1, "reason": reason}]
    assert found["frames"] == 3 and manifest[1]["radar"] is None


def test_the_lidar_is_kept_where_the_radar_sent_points(manifest):
    records = Records(manifest[0])

    def at_pillar(frame):
        apart = np.linalg.norm(frame.lidar_xyz[:, :2] - PILLAR, axis=1)
        return int((apart < 0.5).sum())

    assert at_pillar(records[0]) == 0 and len(records[0].lidar_xyz) > 100
    assert at_pillar(records[1]) > 10


def test_samples_and_points_need_folders_of_their_own(walk, manifest, tmp_path):
    samples = write_sequence(tmp_path / "in", "run0", frames=1)
    with pytest.raises(UsageError, match="run0 holds a radar's samples and walk the "):
        prepare([samples, walk], tmp_path / "out", SPEC, workers=1)
    assert not (tmp_path / "out" / "manifest.json").exists()
    kinds = "holds records of points, now of samples"
    with pytest.raises(UsageError, match=f"with other radar: it {kinds}"):
        prepare(samples, manifest[0], SPEC, workers=1)


def test_cells_of_points_are_refused(manifest):
    frame = Records(manifest[0])[0]
    with pytest.raises(UsageError, match="walk, frame 0: the record holds a radar's"):
        cells_of(frame)


def test_a_bag_without_places_says_so(tmp_path, monkeypatch):
    names = ("x", "y", "z", "doppler")
    monkeypatch.setattr(bag_writer, "FIELDS", [(name, 7, "f") for name in names])
    path = write_astyx(tmp_path / "room.npz", [BOTH])
    xyz = open_recording(path).frames[0].xyz
    columns = dict(zip(names, np.column_stack([xyz, 0 * xyz[:, 0]]).T, strict=True))
    scan = room_scan(np.random.default_rng(0))[:, :3].tolist()
    rows = [(0, *point, 9, 0, 0) for point in scan]
    messages, first, step = [], bag_writer.START, bag_writer.TENTH
    for stamp in range(first, first + 3 * step, step):
        cloud = bag_writer.point_cloud2(columns, stamp)
        scan = bag_writer.livox(rows, stamp)
        messages += [("/radar", bag_writer.CLOUD, stamp, cloud)]
        messages += [("/scan", bag_writer.LIVOX, stamp, scan)]
    bag = bag_writer.write_bag(tmp_path / "bag", "mcap", messages)
    found = prepare(bag, tmp_path / "out", SPEC, workers=1)
    records = Records(tmp_path / "out")
    assert len(records) == 3 and len(records[0].lidar_xyz) > 100
    np.testing.assert_array_equal(records[2].radar.xyz[: len(xyz)], xyz)
    (sequence,) = found["sequences"]
    assert sequence["notes"][-1] == NO_PLACE
