"""A recording of points is played at its times."""

import time
import types
from pathlib import Path

import numpy as np
import pytest

from jradar import PointCloud
from jradar.recordings import Recording, Stream
from jradar.stream.live import run_live, summary
from jradar.stream.player import Player, periods
from jradar.stream.processing import Processor
from tests.stream.loops import PATIENCE_S, wait_until

CLOUDS = [
    PointCloud(np.full((k, 3), k, np.float32), np.ones(k, bool))  # pyright: ignore
    for k in range(1, 5)
]


def points(stamps=None):
    return Stream(CLOUDS.__getitem__, len(CLOUDS), stamps)


class Kept:
    """A writer that keeps what it gets."""

    def __init__(self):
        self.frames = []

    def write(self, frame):
        """Keep the frame."""
        self.frames.append(frame)

    def save(self):
        """Nothing is to be saved."""

    def close(self):
        """Nothing is left to do."""


@pytest.mark.parametrize(
    ("stamps", "expected"),
    [
        (None, [0.1, 0.1, 0.1, 0.1]),
        ([7.0, 7.5, 8.5, 8.75], [0.5, 1.0, 0.25, 0.5]),
        ([7.0, 6.0, 8.0, 8.5], [0.0, 2.0, 0.5, 0.5]),
    ],
)
def test_periods_are_those_of_the_stamps(stamps, expected):
    stamps = None if stamps is None else np.array(stamps)
    np.testing.assert_allclose(periods(points(stamps)), expected)


def test_every_frame_comes_not_before_its_time():
    with Player(points(np.array([0.0, 0.4, 0.6, 1.2])), speed=2, waiting=9) as player:
        begin = time.monotonic()
        wait_until(lambda: player.finished, "the last frame")
        frames = [player.take(0.0) for _ in CLOUDS]
    arrived = [frame.arrived_s - begin for frame in frames]
    assert (np.array(arrived) > np.array([0.0, 0.2, 0.3, 0.6]) - 0.05).all()
    assert [frame.data for frame in frames] == CLOUDS
    assert [frame.number for frame in frames] == [0, 1, 2, 3]


def test_a_session_publishes_the_radars_points_the_scans_and_the_poses():
    pose = np.eye(4)
    pose[0, 3] = 2.0
    lidar = Stream(lambda k: np.full((1, 4), k + 1, "f4"), 4, 10 + 0.02 * np.arange(4))
    recording = Recording(
        name="walk",
        path=Path("walk"),
        points=points(10 + 0.02 * np.arange(4)),
        lidar=lidar,
        base_from_radar=pose,
        base_from_lidar=np.eye(4),
    )
    kept = Kept()
    with Player(recording.frames, speed=0.1, waiting=9) as player:
        session = run_live(
            player,
            Processor(recording),
            [kept],
            silence_s=PATIENCE_S,
            finished=lambda: player.finished,
        )
    told = summary(session, player)
    assert told["frames received"] == told["frames published"] == 4
    assert not told["frames dropped"] and "packets" not in told
    for number, frame in enumerate(kept.frames):
        cloud = frame.clouds["radar"]
        np.testing.assert_array_equal(cloud.xyz[cloud.valid], CLOUDS[number].xyz)
        scan = frame.clouds["lidar"].xyz
        np.testing.assert_allclose(scan, [[number - 1, number + 1, number + 1]])
        assert frame.picture is None and "enhanced" not in frame.clouds


def test_motion_between_frames_is_that_of_the_recording_not_of_its_replay():
    stamps = 1e9 + np.array([0.0, 0.1, 0.2, 0.4])
    processor = Processor(Recording("walk", Path("walk"), points=points(stamps)))
    seen = []

    def frame(number, cloud, stamp_s):
        seen.append((number, stamp_s))
        held = {"samples": None, "points": cloud, "cloud": cloud, "verdict": ()}
        return types.SimpleNamespace(**held)

    processor.pipeline = types.SimpleNamespace(frame=frame)
    for number in (0, 3, 4):  # the last is the first again
        shown = processor.published(CLOUDS[number % 4], number, 2e9 + number)
        assert shown.stamp_s == 2e9 + number
    assert seen == [(0, stamps[0]), (3, stamps[3]), (4, stamps[0])]


def test_a_recording_is_repeated_with_numbers_that_go_on():
    with Player(points(), speed=100, repeat=True, waiting=99) as player:
        wait_until(lambda: player.received > 8, "the second time")
        frames = [player.take(0.0) for _ in range(8)]
    assert [frame.data for frame in frames] == [*CLOUDS, *CLOUDS]
    assert [frame.number for frame in frames] == [*range(8)]
    assert not player.finished


def test_a_damaged_frame_ends_the_session_after_those_before_it():
    def read(index):
        if index == 2:
            raise ValueError("walk.bag: frame 2 is damaged")
        return CLOUDS[index]

    with Player(Stream(read, 4), speed=100, waiting=9) as player:
        wait_until(lambda: player._fault, "the damaged frame")
        assert player.take(0.0).data is CLOUDS[0]
        assert player.take(0.0).data is CLOUDS[1]
        with pytest.raises(ValueError, match="frame 2 is damaged"):
            player.take(0.0)


def test_a_gap_of_the_recording_is_reported_not_refused():
    said = []
    with Player(points(np.array([0.0, 0.1, 900.0, 900.1]))) as player:
        run_live(
            player,
            Processor(Recording("walk", Path("walk"), points=points())),
            [],
            silence_s=0.3,
            say=said.append,
            finished=lambda: bool(said),
        )
    assert said == ["by its times, the recording has no frame for 899.9 s"]
