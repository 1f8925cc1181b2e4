"""Streams are read on access; `describe` reports rates, faults and single files."""

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.lidar import Poses, rigid_transform
from jradar.radar import Radar, RadarSpec
from jradar.recordings import (
    Recording,
    Stream,
    describe,
    describe_file,
    without_background,
)
from jradar.recordings.describe import yaw_pitch_roll

RADAR = RadarSpec.awr1843(num_samples=8, num_chirps=4)
UNIT = Radar(
    RADAR,
    channels=np.ones((3, 4), complex),
    leakage=np.ones((3, 4, RADAR.num_samples // 2), complex),
    range_bias_m=0.07,
)
EVERY_100_MS = np.arange(10) / 10


def cubes(stamps, count=10):
    return Stream(
        lambda item: np.full(RADAR.cube_shape, item - 3j, np.complex64), count, stamps
    )


def scans(stamps):
    scan = np.array([[1, 2, 3, 4], [0, 0, 0, 0], [np.nan, 0, 0, 0]], np.float32)
    return Stream(lambda item: scan[: 1 + item % 3], len(stamps), stamps)


def recording(tmp_path, stamps, **others):
    radar = others.pop("radar", Radar(RADAR))
    return Recording("run", tmp_path, radar, cubes(stamps), **others)


def test_a_stream_reads_what_is_asked_for_and_nothing_else():
    asked = []

    def read(item):
        asked.append(item)
        return np.array([item])

    stream = Stream(read, 5, np.arange(5.0), ("a note",))
    assert len(stream) == 5 and stream.notes == ("a note",) and not asked
    assert [a.tolist() for a in (stream[-1], *stream[1:3])] == [[4], [1], [2]]
    assert asked == [4, 1, 2]
    for item in (5, -6):
        with pytest.raises(IndexError, match=f"item {item} of a stream of 5"):
            stream[item]
    with pytest.raises(ValueError, match="4 stamps for 5 items"):
        Stream(read, 5, np.arange(4.0))


def test_the_leakage_is_part_of_the_background(tmp_path):
    whole = recording(tmp_path, EVERY_100_MS, radar=UNIT)
    left = without_background(whole, slice(2, 5))
    assert left.radar.leakage is None and left.radar.channels is not None
    assert len(left.cubes) == 10 and left.cubes.stamps is EVERY_100_MS
    assert "the mean of frames 2 to 4 is subtracted" in left.notes[-1]


@pytest.mark.parametrize(
    ("stamps", "rate", "longest", "faults"),
    [
        (EVERY_100_MS, 10, 0.1, [0, 0, 0]),
        (np.array([0, 1, 2, 2, 3, 7, 8, 7.5, 8.5, 9.5]) / 10, 10, 0.4, [1, 1, 1]),
        (None, None, None, [None, None, None]),
        (np.zeros(10), None, None, [None, 9, 0]),
    ],
    ids=["steady", "faults", "unknown", "zero"],
)
def test_rates_gaps_repeats_and_steps_back(tmp_path, stamps, rate, longest, faults):
    found = describe(recording(tmp_path, stamps))
    [timing] = found["streams"]
    assert timing["stream"] == "radar" and timing["items"] == found["frames"] == 10
    assert timing["rate_hz"] == (rate and pytest.approx(rate))
    assert [timing[k] for k in ("gaps", "repeated", "backwards")] == faults
    if rate:
        assert timing["longest_gap_s"] == pytest.approx(longest)
        assert timing["seconds"] == pytest.approx(stamps[-1])
    frames = {"frame 0": "yes, counts up to 3", "frame 9": "yes, counts up to 9"}
    assert found["readable"] == frames
    assert found["calibration"] == ["none"] and found["transforms"] == {}


def test_frames_with_scans_and_poses_are_counted(tmp_path):
    poses = Poses(np.array([0.25, 1.0]), np.zeros((2, 3)), np.eye(4)[[3, 3]])
    lidar = scans(np.array([0.0, 0.34, 0.851, 0.16]))
    found = describe(recording(tmp_path, EVERY_100_MS, lidar=lidar, poses=poses))
    expected = sum(min(abs(lidar.stamps - stamp)) <= 0.05 for stamp in EVERY_100_MS)
    assert found["frames with a LiDAR scan"] == expected == 4
    assert found["frames with a pose"] == 7  # 0.3 to 0.9
    assert [s["stream"] for s in found["streams"]] == ["radar", "lidar", "poses"]
    assert found["readable"]["scan 0"] == "yes, 1 points, 1 of them returns"
    assert found["readable"]["scan 3"] == "yes, 1 points, 1 of them returns"
    lidar = Stream(lambda item: np.zeros((0, 4), np.float32), 0, np.zeros(0))
    found = describe(recording(tmp_path, EVERY_100_MS, lidar=lidar))
    assert found["frames with a LiDAR scan"] == 0
    assert [*found["readable"]] == ["frame 0", "frame 9"]


def test_unreadable_items_are_reported(tmp_path):
    def read(item):
        raise ValueError(f"frame_{item}.bin holds 3 bytes")

    broken = recording(tmp_path, EVERY_100_MS)._replace(cubes=Stream(read, 10))
    readable = describe(broken)["readable"]
    assert readable["frame 9"] == "cannot be read: frame_9.bin holds 3 bytes"


def test_angles_of_a_transform_are_scipys():
    turns = Rotation.random(20, random_state=0)
    matrices = np.tile(np.eye(4), (20, 1, 1))
    matrices[:, :3, :3] = turns.as_matrix()
    angles = [yaw_pitch_roll(matrix) for matrix in matrices]
    np.testing.assert_allclose(angles, turns.as_euler("ZYX", degrees=True), atol=1e-9)
    moved = rigid_transform(np.zeros((20, 3)), 3 * turns.as_quat())
    np.testing.assert_allclose(moved, matrices, atol=1e-12)


def test_transforms_calibration_and_losses(tmp_path):
    half = math.sqrt(0.5)
    found = recording(
        tmp_path,
        EVERY_100_MS,
        base_from_radar=rigid_transform(np.zeros(3), np.array([0, 0, half, half])),
        base_from_lidar=rigid_transform(np.array([1.0, 0, 2]), np.eye(4)[3]),
        radar=UNIT,
        lost_bytes=np.array([0, 5, 0, 7, 0, 0, 0, 0, 0, 0]),
        notes=("mended",),
    )
    described = describe(found)
    radar, lidar, between = described["transforms"].values()
    np.testing.assert_allclose(radar["yaw_pitch_roll_deg"], [90, 0, 0], atol=1e-9)
    assert lidar["xyz_m"] == [1, 0, 2]
    np.testing.assert_allclose(between["xyz_m"], [0, -1, 2], atol=1e-12)
    np.testing.assert_allclose(between["yaw_pitch_roll_deg"], [-90, 0, 0], atol=1e-9)
    assert described["calibration"] == [
        f"leakage, 3 x 4 x {RADAR.num_samples // 2} [tx, rx, range bin]",
        "factors of 12 virtual antennas",
        "range bias 0.07 m",
    ]
    assert (described["lost bytes"], described["frames with losses"]) == (12, 2)
    assert described["notes"] == ["mended"]
    assert json.loads(json.dumps(described)) == described


def test_points_and_bounds_of_a_cloud(tmp_path):
    path = tmp_path / "lidar_pointcloud_7.bin"
    points = [[1, -2, 3, 9], [0, 0, 0, 0], [np.nan, 1, 1, 1], [-4, 5, 0.5, 1]]
    path.write_bytes(np.array(points, "<f4").tobytes())
    found = describe_file(path)
    assert (found["points"], found["finite and not (0, 0, 0)"]) == (4, 2)
    assert found["lowest_m"] == [-4, -2, 0.5] and found["highest_m"] == [1, 5, 3]
    path.write_bytes(b"")
    empty = describe_file(path)
    assert empty["points"] == 0 and "lowest_m" not in empty
    assert describe_file(tmp_path / "adc_data.bin") is None


def test_topics_of_a_bag(tmp_path):
    pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
    from tests.recordings.bag_writer import LIVOX, START, livox, livox_rows, write_bag

    stamps = [START + n * 10**8 for n in (0, 1, 2, 7)]
    messages = [("/l", LIVOX, t + 5, livox(livox_rows(2), t)) for t in stamps]
    path = write_bag(tmp_path, "mcap", messages)
    plain = {"topic": "/l", "type": LIVOX, "messages": 4, "gaps": 1}
    times = {"first_s": START / 1e9, "last_s": START / 1e9 + 0.7, "seconds": 0.7}
    times["longest_gap_s"] = 0.5
    for bag in (path, path / "mcap.mcap"):
        found = describe_file(bag)
        [topic] = found["topics"]
        assert plain.items() <= topic.items() and found["notes"] == []
        assert {name: topic[name] for name in times} == pytest.approx(times, abs=1e-6)
        assert topic["rate_hz"] == pytest.approx(10, abs=1e-3)


def test_times_of_every_topic_of_a_real_bag(samples):
    bag = samples / "reve" / "demo_ti_mmwave_rospkg_format.bag"
    rows = {row["topic"]: row for row in describe_file(bag)["topics"]}
    imu = rows["/sensor_platform/imu"]
    assert imu["messages"] == 8270 and imu["rate_hz"] == pytest.approx(202, abs=1)
    assert imu["last_s"] - imu["first_s"] == pytest.approx(imu["seconds"])
    assert rows["/ti_mmwave/radar_scan_pcl"]["seconds"] == pytest.approx(40.1, abs=0.1)
