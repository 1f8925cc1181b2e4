"""The place of a radar from its motion: found by turns, kept without, honest."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.calibration import mount_from_motion
from jradar.calibration.mount import LIMITS, MATCHED, MOTIONS, SYSTEMATIC, Mount
from jradar.lidar import Poses
from jradar.motion import Velocities
from jradar.radar import Radar, RadarSpec
from jradar.recordings import write_radar_toml
from jradar.recordings.radar_toml import read_radar_toml
from jradar.simulation.scenes.trajectory import pose_at, walk

CORNERS = np.array([[0.0, 0, 1], [6, 0, 1], [6, 4, 1], [3, 4, 1], [3, 7, 1], [0, 7, 1]])
EPOCH_S, OFFSET_S = 1.7e9, 0.03
NOISE_MPS = np.array([0.03, 0.04, 0.06])


def place(seed):
    """A mount that differs from its description, the identity."""
    random = np.random.default_rng([seed, 1])
    mount = np.eye(4)
    turn = Rotation.from_rotvec(np.radians(4 * random.standard_normal(3)))
    mount[:3, :3], mount[:3, 3] = turn.as_matrix(), 0.12 * random.standard_normal(3)
    return mount


def measured(pose, mount, seed=0, *, elevation=True):
    """30 s of velocities and poses of a rig whose `pose` is a function of time."""
    random = np.random.default_rng(seed)
    stamps = 0.2 + np.arange(300) * 0.1
    at = stamps + OFFSET_S

    def radar(time):
        xyz, turn = pose(time)
        return xyz + turn @ mount[:3, 3]

    world = (radar(at + 1e-4) - radar(at - 1e-4)) / 2e-4
    velocity = np.einsum("tji,tj->ti", pose(at)[1] @ mount[:3, :3], world)
    velocity += NOISE_MPS * random.standard_normal(velocity.shape)
    covariance = np.tile(np.diag(NOISE_MPS**2), (300, 1, 1))
    if not elevation:
        velocity[:, 2], covariance[:, 2, 2] = 0, np.inf
    count = np.full(300, 30)
    times = np.arange(310) * 0.1
    xyz, turn = pose(times)
    xyz = xyz + 0.005 * random.standard_normal(xyz.shape)
    noise = Rotation.from_rotvec(1e-3 * random.standard_normal(xyz.shape))
    poses = Poses(EPOCH_S + times, xyz, (Rotation.from_matrix(turn) * noise).as_quat())
    counts = (count, count, count)
    return Velocities(EPOCH_S + stamps, velocity, covariance, *counts), poses


def found(seed, *, matched=False, **options) -> tuple[Mount, np.ndarray]:
    """The mount by a walk of turns with sway, and the errors of its seven axes."""
    way = walk(np.random.default_rng(seed), CORNERS, speed_mps=1, hand_held=True)
    true = place(seed)
    velocities, poses = measured(lambda t: pose_at(way, t), true, seed, **options)
    mount = mount_from_motion(velocities, poses, np.eye(4), matched=matched)
    turn = Rotation.from_matrix(true[:3, :3].T @ mount.base_from_radar[:3, :3])
    shift = mount.base_from_radar[:3, 3] - true[:3, 3]
    return mount, np.r_[turn.as_rotvec(), shift, mount.offset_s - OFFSET_S]


def test_turns_show_the_place_and_deviations_are_honest():
    shares = []
    for seed in range(10):
        mount, error = found(seed)
        yaw_and_place = [2, 3, 4, 5, 6]
        assert mount.observed[yaw_and_place].all()
        assert (np.abs(error[yaw_and_place]) < LIMITS[yaw_and_place]).all()
        assert np.abs(error[1]) < LIMITS[1]  # without echoes of floors
        noise = np.sqrt(mount.deviation**2 - SYSTEMATIC**2)
        assert (noise[yaw_and_place] > 1e-4).all()
        shares.append(np.abs(error) < 2 * noise)
    assert 0.85 < np.mean(shares) <= 0.99


def straight(time):
    """A cart that drives straight ahead at a varying speed, without turns."""
    time = np.asarray(time)
    xyz = np.stack([time + 0.3 * np.sin(time), 0 * time, 0 * time], -1)
    return xyz, np.tile(np.eye(3), (*time.shape, 1, 1))


def test_without_turns_the_place_is_refused_and_the_rest_is_found():
    true = place(3)
    mount = mount_from_motion(*measured(straight, true), np.eye(4))
    assert mount.observed.tolist() == [False, False, True, False, False, False, True]
    assert mount.missing() == MOTIONS[:3]
    assert np.abs(mount.base_from_radar[:3, 3]).max() < 0.02  # as described
    ahead = np.degrees(np.arccos(true[0] @ mount.base_from_radar[0]))
    assert ahead < 1 and mount.offset_s == pytest.approx(OFFSET_S, abs=0.01)
    rows = mount.describe()["mount"]
    assert [row["shown by the walk"] for row in rows] == mount.observed.tolist()


def test_poses_of_matched_scans_show_the_yaw_alone():
    mount, error = found(4, matched=True)
    assert mount.observed.tolist() == [False, False, True, False, False, False, False]
    assert (mount.deviation >= MATCHED).all()
    assert np.abs(error[2]) < LIMITS[2]


def test_a_row_of_antennas_shows_yaw_and_place_on_the_level():
    mount, error = found(4, elevation=False)
    assert mount.observed[[2, 3, 4]].all() and (np.abs(error) < LIMITS)[[2, 3, 4]].all()


def test_a_radar_upside_down_is_noticed():
    way = walk(np.random.default_rng(5), CORNERS, speed_mps=1, hand_held=True)
    true = place(5)
    true[:3, :3] = true[:3, :3] @ np.diag([1, -1, -1])
    velocities, poses = measured(lambda t: pose_at(way, t), true)
    mount = mount_from_motion(velocities, poses, np.eye(4))
    (warning,) = mount.warnings()
    assert "upside_down = true" in warning
    assert np.degrees(np.linalg.norm(mount.turned)) > 160
    level = mount_from_motion(velocities, poses, true)
    assert level.warnings() == ()
    (warning,) = level.warnings(matched=True)
    assert "matched LiDAR scans" in warning


def test_walks_of_no_use_are_refused():
    velocities, poses = measured(straight, np.eye(4))
    still = velocities._replace(velocity=0 * velocities.velocity)
    random = np.random.default_rng(0).standard_normal((300, 3))
    for wrong, message in (
        (still, "moves by 0.00 m/s, expected 0.1"),
        (velocities._replace(velocity=random), "whatever the mount"),
        (velocities._replace(stamps=velocities.stamps + 100), "do the clocks agree"),
    ):
        with pytest.raises(ValueError, match=message):
            mount_from_motion(wrong, poses, np.eye(4))


def test_the_description_carries_the_mount(tmp_path):
    file, mount = tmp_path / "radar.toml", place(6)
    write_radar_toml(file, Radar(RadarSpec.awr1843()), mount=mount)
    _, capture = read_radar_toml(file)
    np.testing.assert_allclose(capture.base_from_radar(), mount, atol=1e-6)
    text = file.read_text().replace("quaternion = [", "quaternion = [2, ")
    file.write_text(text)
    with pytest.raises(ValueError, match=r"\[mount\].*expected xyz and quaternion"):
        read_radar_toml(file)
