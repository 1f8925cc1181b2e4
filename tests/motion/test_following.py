"""The last frames' places: closed forms of a circle, what is unknown, causality."""

import numpy as np
import pytest

from jradar.motion import Follower
from jradar.radar import Radar, RadarSpec
from tests.motion.test_trajectory import (
    IMU_PLACE,
    MOUNT,
    STAMPS,
    TIMES,
    circle,
    poses_on,
    recording,
    true_imu,
    velocities_on,
)

VELOCITY = velocities_on(circle, STAMPS).velocity
FRAMES = 4


def follow(found, velocity=VELOCITY, last=9):
    """The newest places after all frames up to `last`, and the follower."""
    follower = Follower(found, frames=FRAMES)
    begin = STAMPS - found.radar.spec.frame_middle_s  # STAMPS are the frames' middles
    places = [follower.step(begin[k], velocity[k]) for k in range(last + 1)]
    return places, follower


def true_places(newest):
    radar = circle(STAMPS) @ MOUNT
    return [np.linalg.solve(radar[newest], radar[newest - k]) for k in range(FRAMES)]


def with_poses(tmp_path):
    return recording(tmp_path, poses=poses_on(circle, TIMES))


def with_imu(tmp_path, **options):
    imu = true_imu(circle, TIMES, **options)
    return recording(tmp_path, imu=imu, base_from_imu=IMU_PLACE)


def test_poses_tell_the_places_and_frames_before_the_first_are_not_invented(tmp_path):
    places, follower = follow(with_poses(tmp_path), VELOCITY * np.nan)
    assert [len(found) for found in places] == [1, 2, 3] + [FRAMES] * 7
    np.testing.assert_array_equal(places[0], np.eye(4)[None])
    np.testing.assert_allclose(places[-1], true_places(9), atol=1e-4)
    assert follower.steps == {"poses": 9}


def test_velocity_and_gyroscope_follow_a_circle(tmp_path):
    places, follower = follow(with_imu(tmp_path))
    np.testing.assert_allclose(places[-1], true_places(9), atol=2e-3)
    assert follower.steps == {"imu": 9}


def test_velocity_alone_takes_the_way_without_the_turn(tmp_path):
    places, follower = follow(recording(tmp_path))
    np.testing.assert_allclose(places[-1][:, :3, :3], [np.eye(3)] * FRAMES)
    true = np.array(true_places(9))
    error = np.linalg.norm(places[-1][:, :3, 3] - true[:, :3, 3], axis=1)
    way = np.linalg.norm(true[:, :3, 3], axis=1)
    assert (error[1:] < 0.1 * way[1:]).all() and follower.steps == {"velocity": 9}


def test_a_gyroscope_learns_its_bias_while_the_rig_stands_still(tmp_path):
    bias = np.array([0.02, -0.03, 0.4])

    def late(stamps):  # stands still for 1 s
        return circle(np.maximum(stamps - 1.0, 0.0))

    imu = true_imu(late, TIMES, bias=bias)
    velocity = velocities_on(late, STAMPS).velocity
    there = recording(tmp_path, imu=imu, base_from_imu=IMU_PLACE)
    radar = late(STAMPS) @ MOUNT
    places, _ = follow(there, velocity, last=40)
    true = [np.linalg.solve(radar[40], radar[40 - k]) for k in range(FRAMES)]
    np.testing.assert_allclose(places[40], true, atol=5e-3)


def test_one_missing_velocity_is_bridged_and_two_are_a_gap(tmp_path):
    for missing, known in (([5], True), ([5, 6], False)):
        velocity = VELOCITY.copy()
        velocity[missing] = np.nan
        places, follower = follow(with_imu(tmp_path), velocity, last=7)
        assert np.isfinite(places[-1][1]).all()  # frame 6 to 7
        assert np.isfinite(places[-1][2:]).all() == known  # over frame 5 to 6
        assert follower.steps["none"] == (not known)


@pytest.mark.parametrize("change", ["no stamps", "a long gap", "one chirp"])
def test_motion_that_cannot_be_known_is_nan(tmp_path, change):
    found = recording(tmp_path)
    stamps = {"no stamps": STAMPS * np.nan, "a long gap": STAMPS * 30}
    stamps = stamps.get(change, STAMPS)
    if change == "one chirp":
        found = found._replace(radar=Radar(RadarSpec.awr1843(num_chirps=1)))
    follower = Follower(found, frames=2)
    follower.step(stamps[0], VELOCITY[0])
    here, before = follower.step(stamps[1], VELOCITY[1])
    np.testing.assert_array_equal(here, np.eye(4))
    assert np.isnan(before).all() and follower.steps == {"none": 1}


def test_what_comes_later_changes_nothing(tmp_path):
    whole, _ = follow(with_imu(tmp_path))
    there = with_imu(tmp_path)
    later = STAMPS[6] + 1e-6
    rate = np.where(there.imu.stamps[:, None] > later + 0.005, 9.0, there.imu.rate)
    velocity = np.where(np.arange(41)[:, None] > 6, np.nan, VELOCITY)
    cut, _ = follow(there._replace(imu=there.imu._replace(rate=rate)), velocity, last=6)
    np.testing.assert_allclose(cut[6], whole[6], atol=1e-9)
