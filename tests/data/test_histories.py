"""Histories: earlier points lie where they are seen now; chips send few cells."""

import numpy as np
import pytest

from jradar.data import HistorySpec, fixed_histories, histories
from jradar.data.histories import MOVES_MPS, History, Sender
from jradar.data.records import PreparedFrame
from jradar.radar import Cells, PointSpec, RadarSpec
from jradar.types import PointCloud

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
CORNERS = np.array([[4.0, 1.0, 0.5], [6.0, -2.0, 0.0], [8.0, 0.5, 1.0], [3.0, 2.0, 0]])
STEP_M, STEP_RAD = 0.1, 0.05


def pose_of(frame):
    """The radar moves 0.1 m a frame and turns to the left, 0.05 rad a frame.

    It looks to the left of where it goes.
    """
    pose, angle = np.eye(4), 1.2 + STEP_RAD * frame
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose[:3, 3] = STEP_M * frame, 0, 1
    return pose


def frame_of(frame, moving=0.0):
    """Corners that stand still and, last, a point with a velocity of its own."""
    pose = pose_of(frame)
    xyz = np.float32((CORNERS - pose[:3, 3]) @ pose[:3, :3])
    ahead = pose[:3, :3].T @ [STEP_M / 0.1, 0, 0]
    velocity = -(xyz / np.linalg.norm(xyz, axis=1, keepdims=True)) @ ahead
    velocity[-1] += moving
    power = np.random.default_rng(frame).exponential(1.0, (32, 64)).astype(np.float32)
    power[16, 20:24] += [0, 1e4, 0, 0]
    angles = np.zeros((2, 32, 64), np.float32)
    return PreparedFrame(
        sequence="walk",
        frame=frame,
        stamp=frame / 10,
        lidar_stamp=frame / 10,
        world_from_radar=pose,
        cells=Cells(power, *angles),
        radar=PointCloud(
            xyz, np.ones(4, bool), velocity.astype(np.float32), np.float32([4, 3, 2, 1])
        ),
        lidar_xyz=np.float32([[frame, 0, 0]]),
    )


def records(count=6, **changes):
    """What histories use of `Records`."""
    frames = [frame_of(k, **changes) for k in range(count)]
    where = [("walk", k) for k in range(count)]

    class Fake(list):
        """A list of frames of one radar."""

    found = Fake(frames)
    found.where, found.radar_of = where, lambda name: RADAR
    found.windows_of = lambda name: ("hann", "hann")
    return found


def valid(cloud):
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


def test_earlier_points_lie_where_they_are_seen_now():
    walk = records()
    found = History(walk, 5, HistorySpec()).of(Sender(), 4)
    assert found.lidar_xyz[0, 0] == 5
    ages = np.asarray(found.radar.age)[np.asarray(found.radar.valid)]
    np.testing.assert_allclose(ages, np.repeat([0, 0.1, 0.2, 0.3], 4), atol=1e-6)
    now = np.tile(walk[5].radar.xyz, (4, 1))
    np.testing.assert_allclose(valid(found.radar), now, atol=1e-5)


def test_what_moves_is_of_the_present_alone():
    found = History(records(moving=2 * MOVES_MPS), 5, HistorySpec()).of(Sender(), 3)
    assert len(valid(found.radar)) == 4 + 3 + 3


def test_a_history_ends_where_the_sequence_or_the_poses_begin():
    walk = records()
    assert len(valid(History(walk, 1, HistorySpec()).of(Sender(), 6).radar)) == 8
    walk.where[2] = ("other", 0)
    assert len(valid(History(walk, 5, HistorySpec()).of(Sender(), 6).radar)) == 12
    walk[4].world_from_radar[:] = np.nan
    assert len(valid(History(walk, 5, HistorySpec()).of(Sender(), 6).radar)) == 4


def test_errors_of_the_motion_grow_with_age():
    history = History(records(), 5, HistorySpec())
    plain, wrong = (
        valid(history.of(Sender(), 3, (speed, 0, 0, 0)).radar) for speed in (0, 0.3)
    )
    apart = np.linalg.norm(wrong - plain, axis=1)
    np.testing.assert_allclose(apart, np.repeat([0.0, 0.03, 0.06], 4), atol=1e-5)


def test_a_chip_sends_the_peak_of_the_cells_rounded():
    spec = PointSpec(detector="so", false_alarm_rate=1e-6, group_peaks=True)
    walk = records()
    found = Sender(spec, most=5, step_m=0.05).sent(walk, walk[0])
    assert 1 <= len(found.xyz) <= 5
    range_m = 21 * RADAR.range_resolution_m
    assert np.linalg.norm(found.xyz[0]) == pytest.approx(range_m, abs=0.15)
    np.testing.assert_allclose(found.xyz / 0.05, np.round(found.xyz / 0.05), atol=1e-4)
    assert Sender(spec, with_power=False).sent(walk, walk[0]).power.max() == 1


def test_without_arguments_a_history_is_the_frame():
    walk = records()
    first, *_ = histories(walk, HistorySpec())
    assert first.drawn(np.random.default_rng(0)) is walk[0]
    assert fixed_histories(walk, HistorySpec())[3] is walk[3]


def test_a_fixed_history_is_drawn_once():
    spec = HistorySpec(frames=4, sparse=0.5, drift=1.0)
    fixed = fixed_histories(records(), spec)
    counts = set()
    for index in range(6):
        one, again = fixed[index], fixed[index]
        np.testing.assert_array_equal(one.radar.xyz, again.radar.xyz)
        counts.add(len(valid(one.radar)))
    assert len(counts) > 2


@pytest.mark.parametrize(
    "values, message",
    [
        ({"frames": 0}, "frames = 0, expected 1"),
        ({"sparse": 2}, "sparse = 2, expected 0"),
    ],
)
def test_values_that_cannot_be_are_refused(values, message):
    with pytest.raises(ValueError, match=message):
        HistorySpec(**values)
