"""Frames of points that a radar sent, which go through the pipeline as they are."""

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.lidar import Poses
from jradar.mapping import map_recording
from jradar.model import enhance_points
from jradar.pipeline import Pipeline, detect_recording, enhance_recording
from jradar.pipeline.together import LastPoints
from jradar.radar import Radar
from jradar.recordings import Recording, Stream
from jradar.types import PointCloud
from tests.models import RADAR, one_pass_model, tiny_map_model
from tests.pipeline.test_polar import MODEL as POLAR

MODEL = one_pass_model()
SIZES = 40, 0, 1500, 7


def points(count, seed=0, *, height_m=1.0, velocity=True):
    """Points of a wall of 4 x 2 m, from 4 to 5 m ahead."""
    rng = np.random.default_rng(seed)
    low, high = [4, -2, -height_m], [5, 2, height_m]
    xyz = rng.uniform(low, high, (count, 3)).astype(np.float32)
    towards = -xyz[:, 0] / np.linalg.norm(xyz, axis=1) if velocity else None
    power = rng.uniform(1, 1e4, count).astype(np.float32)  # not taken for dB
    return PointCloud(xyz, np.ones(count, bool), towards, power)


def recording(*clouds, radar=None, poses=False):
    """Frames of these points at 10 Hz; the radar moves 0.1 m ahead from each."""
    stamps = 0.1 * np.arange(len(clouds))
    times = np.arange(-0.5, 0.1 * len(clouds) + 0.5, 0.1)
    xyz = np.stack([times, 0 * times, 0 * times], 1)
    turns = np.tile([0.0, 0, 0, 1], (len(times), 1))
    place = {}
    if poses:
        place = {"poses": Poses(times, xyz, turns), "base_from_radar": np.eye(4)}
    stream = Stream(clouds.__getitem__, len(clouds), stamps)
    return Recording("walk", Path("walk"), radar, points=stream, **place)


def test_a_frame_is_what_enhance_points_gives_whatever_its_size():
    walk = recording(*(points(size, size) for size in SIZES))
    found = enhance_recording(walk, MODEL)
    key = jax.random.key(0)
    for frame, size in zip(found, SIZES, strict=True):
        expected = enhance_points(key, points(size, size).padded(), MODEL)
        np.testing.assert_array_equal(frame.cloud.valid, expected.valid)
        np.testing.assert_allclose(frame.cloud.xyz, expected.xyz, atol=1e-4)
        assert frame.samples is None and frame.detected is None
        assert frame.describe()["radar points"] == size
        assert frame.empty == (size == 0)
        assert frame.stamp_s == pytest.approx(0.1 * frame.number)
    assert any("no echoes in frame 1" in text for text in found.warnings)
    compiling = found.watch["compiling"]
    assert len(compiling) == 2 and found.times["compiling"] == sum(compiling)
    assert any("not on those that a radar sends" in text for text in found.warnings)


def test_a_model_that_learned_from_such_points_is_not_warned_of():
    card = dataclasses.replace(MODEL.card, sent_points=True)
    found = enhance_recording(
        recording(points(30)), dataclasses.replace(MODEL, card=card)
    )
    _ = [*found]
    assert not any("not on those that a radar sends" in text for text in found.warnings)


def test_padding_adds_points_that_are_not_valid():
    cloud = points(1025)
    padded = cloud.padded()
    assert padded.valid.shape == (4096,) and padded.xyz.shape == (4096, 3)
    assert padded.valid.sum() == 1025 and not padded.valid[1025:].any()
    np.testing.assert_array_equal(padded.velocity[:1025], cloud.velocity)
    with pytest.raises(ValueError, match="70,000 points, expected at most 65,536"):
        points(70_000).padded()


def test_a_cloud_of_one_of_the_sizes_is_not_padded():
    for count in (1024, 4096):
        assert points(count).padded().valid.shape == (count,)


def test_the_share_of_points_out_of_view_is_said():
    near, far = points(30), points(30)
    far = far._replace(xyz=far.xyz * 20)
    found = enhance_recording(recording(near, far), MODEL)
    _ = [*found]
    (text,) = [text for text in found.warnings if "out of the model's view" in text]
    assert text.startswith("50% of the points are out") and "ends at" in text
    found = enhance_recording(recording(near), MODEL)
    _ = [*found]
    assert not any("out of the model's view" in text for text in found.warnings)


def test_points_in_one_plane_are_refused_unless_anyway():
    flat = recording(points(30, height_m=0.0))
    with pytest.raises(UsageError, match="all lie in one plane"):
        enhance_recording(flat, MODEL)
    (frame,) = enhance_recording(flat, MODEL, anyway=True)
    assert frame.describe()["radar points"] == 30
    assert recording(points(0)).has_elevation  # which no point denies
    assert recording(points(0), points(9)).has_elevation


def test_what_needs_samples_is_refused():
    walk = recording(points(30), points(30), radar=Radar(RADAR))
    for needs in (
        lambda: detect_recording(walk),
        lambda: enhance_recording(walk, MODEL, remove_interference=True),
        lambda: walk.cube(0),
    ):
        with pytest.raises(
            UsageError, match="holds a radar's points, expected its raw"
        ):
            needs()
    pipeline = Pipeline(walk, POLAR, anyway=True)
    with pytest.raises(UsageError, match="polar images sees a radar's samples"):
        pipeline.frame(0, walk.frames[0])


@pytest.mark.parametrize("velocity", [True, False])
def test_frames_of_points_are_fused_by_their_poses(velocity):
    first, second = (points(60, seed, velocity=velocity) for seed in (1, 2))
    walk = recording(first, second, poses=True)
    found = enhance_recording(walk, MODEL, fuse=2)
    frames = [*found]
    assert found.motion == {"poses": 1}
    (alone,) = enhance_recording(walk, MODEL, frames=range(1, 2))
    both = [np.asarray(frame.image.range_m) for frame in (frames[1], alone)]
    assert not np.array_equal(*both)  # the frame before it counts


def test_a_map_of_points_leaves_out_what_moves():
    walk = [points(80, seed) for seed in range(12)]
    still = map_recording(recording(*walk, poses=True), tiny_map_model())
    with_mover = []
    for cloud in walk:
        mover = np.tile(np.float32([[2.0, 0, 0.5]]), (5, 1))
        xyz = np.concatenate([cloud.xyz, mover])
        velocity = np.append(cloud.velocity, np.full(5, 3.0)).astype(np.float32)
        power = np.append(cloud.power, np.ones(5)).astype(np.float32)
        with_mover.append(PointCloud(xyz, np.ones(85, bool), velocity, power))
    found = map_recording(recording(*with_mover, poses=True), tiny_map_model())
    voxels = [set(map(tuple, each.radar.voxels.tolist())) for each in (still, found)]
    assert len(voxels[0]) > 50 and voxels[0] == voxels[1]
    np.testing.assert_allclose(np.ptp(found.path, axis=0), (1.1, 0, 0), atol=1e-6)


def test_a_bag_of_enhanced_frames_is_a_recording_of_the_points(tmp_path):
    """Its own cloud is not taken for a LiDAR's, and its points give the same cloud."""
    pytest.importorskip("rosbags")
    from jradar.outputs.published import published_frame
    from jradar.outputs.writers import open_writer
    from jradar.recordings import open_recording

    walk = recording(*(points(50, seed) for seed in range(4)), poses=True)
    found = enhance_recording(walk, MODEL)
    writer, clouds = open_writer(tmp_path / "walk.ros2"), []
    for frame in found:
        writer.write(published_frame(walk, frame))
        clouds.append(frame.cloud)
    writer.close()
    again = open_recording(tmp_path / "walk.ros2")
    assert again.lidar is None and len(again.points) == 4
    np.testing.assert_allclose(again.base_from_radar, np.eye(4))
    np.testing.assert_allclose(again.poses.xyz[:, 0], [0, 0.1, 0.2, 0.3], atol=1e-6)
    for frame, cloud in zip(enhance_recording(again, MODEL), clouds, strict=True):
        np.testing.assert_array_equal(frame.cloud.valid, cloud.valid)
        np.testing.assert_allclose(frame.cloud.xyz, cloud.xyz, atol=1e-4)


def walk_past(count, *, poses, jump=None, period_s=0.1):
    """Frames of points at rest, and of one that moves, from a radar that moves ahead.

    With `jump`, the poses from that frame on are 1 m farther ahead.
    """
    rng, clouds = np.random.default_rng(5), []
    world = rng.uniform([4, -3, -1], [9, 3, 1], (60, 3))
    for k in range(count):
        xyz = np.concatenate([world, [[4.0, 2.0, 0.5]]]) - [0.1 * k, 0, 0]
        away = xyz / np.linalg.norm(xyz, axis=1, keepdims=True)
        velocity = -away[:, 0] * 0.1 / period_s
        velocity[-1] += 2.0
        valid = np.ones(len(xyz), bool)
        columns = (np.float32(column) for column in (xyz, velocity))
        xyz, velocity = columns
        clouds.append(PointCloud(xyz, valid, velocity))
    walk = recording(*clouds, poses=poses)
    stamps = period_s * np.arange(count)
    walk = walk._replace(points=Stream(clouds.__getitem__, count, stamps))
    if jump is not None:
        xyz = walk.poses.xyz.copy()
        xyz[walk.poses.stamps > stamps[jump] - 0.05, 0] += 1.0
        walk = walk._replace(poses=walk.poses._replace(xyz=xyz))
    return walk


def joined(walk, seconds):
    last = LastPoints(walk, seconds)
    stamps = walk.points.stamps
    clouds = [
        last.add(k, stamps[k], walk.frames[k].padded()) for k in range(len(stamps))
    ]
    return clouds, [*last.warnings()]


@pytest.mark.parametrize("poses", [True, False])
def test_points_of_the_last_seconds_lie_where_they_are_now(poses):
    clouds, warnings = joined(walk_past(8, poses=poses), 0.35)
    cloud = clouds[-1]
    ages, valid = np.asarray(cloud.age), np.asarray(cloud.valid)
    np.testing.assert_allclose(np.unique(ages[valid]), [0, 0.1, 0.2, 0.3], atol=1e-6)
    assert valid.sum() == 61 + 3 * 60  # the mover is of the present frame alone
    present = np.asarray(cloud.xyz)[:60]
    for part in range(3):
        earlier = np.asarray(cloud.xyz)[61 + 60 * part :][:60]
        np.testing.assert_allclose(earlier, present, atol=1e-2 if poses else 0.05)
    assert not warnings


def test_points_of_the_last_seconds_lie_where_they_are_to_a_radar_that_turns():
    count, stamps = 4, 0.1 * np.arange(4)
    yaw = Rotation.from_rotvec(np.outer(0.1 * np.arange(count), [0, 0, 1]))
    world = np.random.default_rng(5).uniform([4, -3, -1], [9, 3, 1], (60, 3))
    clouds = [PointCloud.from_xyz(yaw[k].inv().apply(world)) for k in range(count)]
    walk = recording(*clouds, poses=True)
    poses = Poses(stamps, np.zeros((count, 3)), yaw.as_quat())
    walk = walk._replace(
        poses=poses, points=Stream(clouds.__getitem__, count, stamps),
        base_from_radar=np.eye(4),
    )  # fmt: skip
    found, _ = joined(walk, 0.35)
    xyz = np.asarray(found[-1].xyz)[np.asarray(found[-1].valid)]
    assert len(xyz) == 4 * 60
    np.testing.assert_allclose(xyz, np.tile(xyz[:60], (4, 1)), atol=1e-3)


@pytest.mark.parametrize(
    ("walk", "seconds", "reason"),
    [
        (walk_past(6, poses=True, jump=3), 1.0, "frame 3: the poses before it jump"),
        (walk_past(3, poses=True, period_s=30.0), 1.0, "the time before it jumps"),
    ],
)
def test_earlier_points_are_dropped_where_motion_breaks(walk, seconds, reason):
    clouds, (warning,) = joined(walk, seconds)
    assert reason in warning
    alone = 3 if "poses" in reason else 1
    assert clouds[alone].valid.sum() == 61 and not np.any(clouds[alone].age)


def test_without_motion_a_frame_stands_alone():
    walk = recording(*(points(60, seed, velocity=False) for seed in range(3)))
    clouds, (warning,) = joined(walk, 1.0)
    assert "frame 1 and 1 more: the radar's motion into it is unknown" in warning
    assert [int(cloud.valid.sum()) for cloud in clouds] == [60, 60, 60]


def test_history_gives_the_same_cloud_wherever_one_starts():
    walk = walk_past(6, poses=True)
    whole = [*enhance_recording(walk, MODEL, history_s=0.25)]
    (last,) = enhance_recording(walk, MODEL, history_s=0.25, frames=range(5, 6))
    np.testing.assert_array_equal(whole[5].cloud.valid, last.cloud.valid)
    np.testing.assert_allclose(whole[5].cloud.xyz, last.cloud.xyz, atol=1e-5)
    assert last.describe()["radar points"] == 61 + 2 * 60


def test_history_and_fusion_exclude_each_other():
    with pytest.raises(UsageError, match="expected one of them"):
        enhance_recording(walk_past(3, poses=True), MODEL, history_s=1.0, fuse=2)
    with pytest.raises(UsageError, match="polar images sees no points"):
        Pipeline(walk_past(3, poses=True), POLAR, history_s=1.0)


def test_the_verdict_is_short_and_begins_with_the_share_that_may_be_right():
    (frame,) = enhance_recording(recording(points(30)), MODEL)
    long = (
        "frame 0 is unlike 99 % of training. Does it move?",
        "do not trust frame 0: why",
    )
    frame = frame._replace(confidence=0.264, warnings=long)
    share, *others = frame.verdict
    assert share == "26% of its points may be right"
    assert others == ["frame 0 is unlike 99 % of training", "do not trust frame 0"]
    assert frame._replace(confidence=None, warnings=()).verdict == ()
