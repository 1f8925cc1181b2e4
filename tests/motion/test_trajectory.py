"""Trajectories from velocities: closed forms of turns, lever arms, gravity, bias."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.lidar import Poses, rigid_transform
from jradar.motion import Velocities, odometry, write_tum
from jradar.motion.attitude import gyro_attitude, gyro_bias, pose_attitude
from jradar.motion.scans import to_poses
from jradar.motion.trajectory import integrate, relative_poses
from jradar.motion.velocities import outliers
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Imu, Recording, Stream, read_tum

YAW = Rotation.from_euler("z", 30, degrees=True).as_quat()
MOUNT = rigid_transform(np.array([0.3, -0.2, 0.1]), YAW)
UPSIDE_DOWN = Rotation.from_euler("x", 180, degrees=True).as_quat()
IMU_PLACE = rigid_transform(np.zeros(3), UPSIDE_DOWN)
STAMPS = np.arange(41) * 0.05
TIMES = np.arange(-20, 441) * 0.005  # of IMU and poses
TURN = 0.8  # rad/s
SPEED = 1.5


def circle(stamps):
    """World_from_base on a circle, heading along it."""
    poses = np.tile(np.eye(4), (len(stamps), 1, 1))
    angle = TURN * stamps
    poses[:, :3, :3] = Rotation.from_euler("z", angle[:, None]).as_matrix()
    radius = SPEED / TURN
    poses[:, 0, 3] = radius * np.sin(angle)
    poses[:, 1, 3] = radius * (1 - np.cos(angle))
    return poses


def velocities_on(poses_at, stamps, mount=MOUNT):
    """The radar's own velocities, by differences of its true positions."""
    step = 1e-5
    before, after = (poses_at(stamps + side) @ mount for side in (-step, step))
    world = (after[:, :3, 3] - before[:, :3, 3]) / (2 * step)
    radar = (poses_at(stamps) @ mount)[:, :3, :3]
    velocity = np.einsum("tji,tj->ti", radar, world)
    count = np.full(len(stamps), 9)
    covariance = np.tile(1e-4 * np.eye(3), (len(stamps), 1, 1))
    return Velocities(stamps, velocity, covariance, count, count, 0 * count)


def true_imu(poses_at, stamps, place=IMU_PLACE, bias=0.0):
    """What an IMU at the base measures."""
    step = 1e-3
    before, now, after = (poses_at(stamps + side) for side in (-step, 0, step))
    force = (after[:, :3, 3] - 2 * now[:, :3, 3] + before[:, :3, 3]) / step**2
    force = force + [0, 0, 9.80665]
    change = before[:, :3, :3].swapaxes(1, 2) @ after[:, :3, :3]
    rate = Rotation.from_matrix(change).as_rotvec() / (2 * step)
    axes = now[:, :3, :3] @ place[:3, :3]
    felt = np.einsum("tji,tj->ti", axes, force)
    return Imu(stamps, felt, rate @ place[:3, :3] + bias)


def poses_on(poses_at, stamps):
    true = poses_at(stamps)
    turns = Rotation.from_matrix(true[:, :3, :3]).as_quat()
    return Poses(stamps, true[:, :3, 3], turns)


def recording(tmp_path, **fields):
    cubes = Stream(lambda k: None, len(STAMPS), STAMPS)
    radar = Radar(RadarSpec.awr1843())
    return Recording("r", tmp_path, radar, cubes, base_from_radar=MOUNT, **fields)


def test_a_straight_way_is_speed_by_time():
    still = np.tile(np.eye(3), (len(STAMPS), 1, 1))
    velocity = np.tile([1.0, 0.5, -0.25], (len(STAMPS), 1))
    velocities = velocities_on(circle, STAMPS)._replace(velocity=velocity)
    found = integrate(velocities, still, np.eye(4))
    end = found.world_from_base[-1, :3, 3]
    np.testing.assert_allclose(end, 2.0 * velocity[0], atol=1e-9)
    assert found.distance_m == pytest.approx(2 * np.linalg.norm(velocity[0]))


def test_a_circle_with_a_lever_arm_is_found_with_the_gyroscope(tmp_path):
    found = odometry(
        recording(tmp_path, imu=true_imu(circle, TIMES), base_from_imu=IMU_PLACE),
        velocities_on(circle, STAMPS),
        rotation="imu",
    )
    np.testing.assert_allclose(found.world_from_base, circle(STAMPS), atol=2e-3)
    assert "never stands still" in found.notes[0]


def test_velocities_that_no_motion_explains_are_bridged(tmp_path):
    there = recording(tmp_path, poses=poses_on(circle, TIMES))
    true = velocities_on(circle, STAMPS)
    wrong = true._replace(velocity=true.velocity.copy())
    wrong.velocity[[7, 20, 21]] += [[0.8, 0, 0], [0, -2, 0], [-1, 1, 0]]
    assert np.flatnonzero(outliers(wrong)).tolist() == [7, 20, 21]
    found = odometry(there, wrong, rotation="poses")
    assert found.notes[0].startswith("the velocity of 3 frames is far from")
    np.testing.assert_allclose(found.world_from_base, circle(STAMPS), atol=0.02)


@pytest.mark.parametrize("rate_hz", [0.3, 1.0, 2.0])
def test_rapid_motion_is_not_an_outlier(rate_hz):
    """Up to 4 g, as of a drone: only its own neighbours say what is usual."""
    swing = np.sin(2 * np.pi * rate_hz * STAMPS)[:, None] * [3.0, 1.0, 0.5]
    noise = np.random.default_rng(0).normal(0, 0.05, swing.shape)
    swinging = velocities_on(circle, STAMPS)._replace(velocity=swing + noise)
    assert not outliers(swinging).any()


def test_odometry_warns_of_the_height_of_an_uncalibrated_radar(tmp_path):
    there = recording(tmp_path)
    rising = np.tile([1.0, 0.0, 0.25], (len(STAMPS), 1))
    velocities = velocities_on(circle, STAMPS)._replace(velocity=rising)
    *_, note = odometry(there, velocities, rotation="none").notes
    assert note.startswith("the path climbs by 0.5 m, and the radar is not calibrated")
    *_, note = odometry(
        there, velocities._replace(velocity=-rising), rotation="none"
    ).notes
    assert note.startswith("the path sinks by 0.5 m")
    measured = there._replace(radar=there.radar.with_factors(np.ones(12)))
    assert odometry(measured, velocities, rotation="none").notes == ()


def test_orientation_of_poses_and_of_nothing(tmp_path):
    there = recording(tmp_path, poses=poses_on(circle, TIMES))
    velocities = velocities_on(circle, STAMPS)
    found = odometry(there, velocities, rotation="poses")
    np.testing.assert_allclose(found.world_from_base, circle(STAMPS), atol=2e-3)
    straight = odometry(there, velocities, rotation="none")
    assert np.abs(straight.world_from_base - circle(STAMPS)).max() > 0.5


def test_frames_outside_the_poses_are_left_out(tmp_path):
    there = recording(tmp_path, poses=poses_on(circle, TIMES[TIMES >= 0.12]))
    found = odometry(there, velocities_on(circle, STAMPS), rotation="poses")
    np.testing.assert_array_equal(found.stamps, STAMPS[3:])
    assert found.notes[0].startswith("3 of 41 frames are outside the poses from 0.120")


def test_a_tilted_start_is_levelled(tmp_path):
    tilt = np.eye(4)
    tilt[:3, :3] = Rotation.from_euler("yx", [20, -10], degrees=True).as_matrix()

    def tilted(stamps):
        return circle(stamps) @ tilt

    imu = true_imu(tilted, TIMES)
    found = odometry(
        recording(tmp_path, imu=imu, base_from_imu=IMU_PLACE),
        velocities_on(tilted, STAMPS),
        rotation="imu",
    )
    up = found.world_from_base[:, 2, :3]
    np.testing.assert_allclose(up, tilted(STAMPS)[:, 2, :3], atol=2e-3)


def test_the_bias_is_the_rate_of_a_rig_that_stands_still():
    times = np.arange(800) * 0.005
    rate = np.where(times[:, None] < 2, [0.01, -0.02, 0.03], [0.3, 0.1, 0.9])
    imu = Imu(times, np.zeros((800, 3)), rate)
    stamps = np.arange(40) * 0.1
    speed = np.where(stamps < 2, 0.02, 1.0)
    np.testing.assert_allclose(gyro_bias(imu, stamps, speed), [0.01, -0.02, 0.03])
    assert gyro_bias(imu, stamps, speed + 0.2) is None
    biased = true_imu(circle, times, bias=np.array([0.01, -0.02, 0.03]))
    found = gyro_attitude(biased, STAMPS, IMU_PLACE, bias=np.array([0.01, -0.02, 0.03]))
    np.testing.assert_allclose(found, circle(STAMPS)[:, :3, :3], atol=1e-4)


def test_rates_between_records_are_linear():
    times = np.arange(11) * 0.1
    imu = Imu(times, np.zeros((11, 3)), times[:, None] * [0.0, 0.0, 2.0])
    expected = Rotation.from_rotvec(times[:, None] ** 2 * [0, 0, 1.0]).as_matrix()
    found = gyro_attitude(imu, times, np.eye(4))
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_frames_without_a_velocity_are_bridged():
    velocities = velocities_on(circle, STAMPS)
    gaps = velocities.velocity.copy()
    gaps[[0, 7, 8, 40]] = np.nan
    turns = circle(STAMPS)[:, :3, :3]
    found = integrate(velocities._replace(velocity=gaps), turns, MOUNT)
    np.testing.assert_allclose(found.world_from_base, circle(STAMPS), atol=5e-3)
    with pytest.raises(ValueError, match="0 velocities"):
        integrate(velocities._replace(velocity=gaps * np.nan), turns, MOUNT)


def test_relative_poses_bring_points_from_frame_to_frame():
    turns = circle(STAMPS)[:, :3, :3]
    found = integrate(velocities_on(circle, STAMPS), turns, MOUNT)
    point = np.array([4.0, 1.0, 0.5, 1.0])  # in the world
    source, target = np.array([0, 10, 40]), np.array([40, 3, 40])
    moves = relative_poses(found, source, target)
    seen = [np.linalg.inv(pose) @ point for pose in circle(STAMPS) @ MOUNT]
    for move, a, b in zip(moves, source, target, strict=True):
        np.testing.assert_allclose(move @ seen[a], seen[b], atol=5e-3)
    np.testing.assert_allclose(relative_poses(found, 10, 3), moves[1])


def test_a_written_trajectory_is_read_again(tmp_path):
    turns = circle(STAMPS)[:, :3, :3]
    found = integrate(velocities_on(circle, STAMPS), turns, MOUNT)
    write_tum(tmp_path / "t.tum", found)
    expected = to_poses(STAMPS, found.world_from_base)
    for one, other in zip(read_tum(tmp_path / "t.tum"), expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-6)


def test_what_a_recording_lacks_is_named(tmp_path):
    velocities = velocities_on(circle, STAMPS)
    there = recording(tmp_path)
    for rotation, message in (
        ("imu", "has no IMU"),
        ("poses", "has no poses"),
        ("lidar", "needs LiDAR scans"),
        ("compass", "expected one of imu"),
    ):
        with pytest.raises(UsageError, match=message):
            odometry(there, velocities, rotation=rotation)
    imu = true_imu(circle, np.arange(100) * 0.005)
    with pytest.raises(ValueError, match="do not cover"):
        gyro_attitude(imu, STAMPS, IMU_PLACE)
    poses = Poses(STAMPS[:5], np.zeros((5, 3)), np.eye(4)[[3] * 5])
    with pytest.raises(ValueError, match="do not cover"):
        pose_attitude(poses, STAMPS)
