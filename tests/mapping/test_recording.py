"""Maps of recordings: where poses come from, and which paths are refused."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from jradar import mapping, open_recording
from jradar.errors import UsageError, first_interrupt_noted
from jradar.lidar import Poses
from jradar.recordings import Recording, Stream
from jradar.recordings.text_files import read_tum
from jradar.types import PointCloud
from tests.models import tiny_map_model
from tests.recordings.small_sequence import write_sequence

FRAMES = 12


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Twelve frames of a room, ten a second, without poses."""
    folder = write_sequence(tmp_path_factory.mktemp("walk"), frames=FRAMES)
    return open_recording(folder)._replace(poses=None, base_from_radar=np.eye(4))


def mapped(recording, steps_m, *, height_m=0.0):
    """The map of a path along x with these steps."""
    xyz = np.zeros((FRAMES + 2, 3))
    xyz[:, 2] = height_m
    xyz[1:, 0] = np.cumsum(np.broadcast_to(steps_m, FRAMES + 1))
    middle = recording.cubes.stamps + recording.radar.spec.frame_middle_s
    stamps = middle[0] + 0.1 * (np.arange(FRAMES + 2) - 1)
    poses = Poses(stamps, xyz, np.tile([0.0, 0, 0, 1], (FRAMES + 2, 1)))
    return mapping.map_recording(recording._replace(poses=poses), tiny_map_model())


def test_a_map_stands_in_the_world_of_the_recorded_poses(recording):
    near, far = mapped(recording, 0.1), mapped(recording, [40] + 12 * [0.1])
    assert near.notes == ()
    np.testing.assert_allclose(np.ptp(near.path, axis=0), (1.1, 0, 0), atol=1e-3)
    moved = far.radar.voxels.mean(0) - near.radar.voxels.mean(0)
    np.testing.assert_allclose(moved * near.grid.voxel_m, (39.9, 0, 0), atol=0.1)


def test_the_trajectory_of_the_base_is_written(recording, tmp_path):
    mount = np.eye(4)
    mount[:3, 3] = 0.0, 0.2, 1.0
    found = mapped(recording._replace(base_from_radar=mount), 0.1)
    mapping.map_files(found)["trajectory.tum"](tmp_path / "t.tum")
    poses = read_tum(tmp_path / "t.tum")
    np.testing.assert_allclose(poses.stamps, found.stamps, atol=1e-6)
    steps = poses.xyz - found.path
    np.testing.assert_allclose(steps, np.tile((0, -0.2, -1), (FRAMES, 1)), atol=1e-6)


def test_without_poses_doppler_gives_the_path(recording):
    found = mapping.map_recording(recording, tiny_map_model())
    assert "poses from Doppler and none" in found.notes
    ground = found.path[:, :2]  # the radar stands; few echoes show its height
    assert np.ptp(ground, axis=0).max() < 0.2


def test_what_moves_is_left_out_of_the_map():
    rng, frames = np.random.default_rng(0), []
    for k in range(FRAMES):
        wall = np.stack([np.full(40, 6 - 0.1 * k), *rng.uniform(-2, 2, (2, 40))])
        person = np.stack([np.full(9, 3.0), *rng.uniform(0.5, 0.6, (2, 9))])
        xyz = np.concatenate([wall, person], 1).T.astype(np.float32)
        towards = -xyz[:, 0] / np.linalg.norm(xyz, axis=1)
        velocity = towards + np.repeat([0, 0.8], [40, 9])
        frames.append(PointCloud(xyz, np.ones(49, bool), np.float32(velocity)))
    stamps = 0.1 * np.arange(FRAMES)
    times = np.arange(-0.5, 2, 0.1)
    rows = np.stack([times, 0 * times, 0 * times], 1)
    walk = Recording(
        "walk",
        Path("walk"),
        points=Stream(frames.__getitem__, FRAMES, stamps),
        poses=Poses(times, rows, np.eye(4)[[3] * len(times)]),
        base_from_radar=np.eye(4),
    )
    x = 0.15 * mapping.map_recording(walk, tiny_map_model()).radar.voxels[:, 0]
    assert len(x) and x.min() > 5.5


def test_a_short_or_standing_walk_is_noted(recording):
    assert "hardly moved" in mapped(recording, 0.01).notes[0]
    found = mapping.map_recording(recording, tiny_map_model(), frames=slice(3))
    assert any(note.startswith("3 frames make a thin map") for note in found.notes)


@pytest.mark.parametrize(("jump", "speeds"), [(1.5, "1.0 to 15.0"), (4, "1.0 to 40.0")])
def test_poses_that_jump_are_noted(recording, jump, speeds):
    steps = np.full(FRAMES + 1, 0.1)
    steps[7] = jump
    (note,) = mapped(recording, steps).notes
    assert note.startswith(f"the poses jump near frame 6, from {speeds} m/s")


@pytest.mark.parametrize("rotation", [None, "poses"])
def test_frames_outside_the_poses_are_left_out(recording, rotation):
    stamps = recording.cubes.stamps[3] + 0.1 * np.arange(10)
    rows = np.stack([0.1 * np.arange(10), *np.zeros((2, 10))], -1)
    there = recording._replace(poses=Poses(stamps, rows, np.eye(4)[[3] * 10]))
    found = mapping.map_recording(there, tiny_map_model(), rotation=rotation)
    first, last = stamps[[0, -1]]
    note = f"3 of 12 frames are outside the poses from {first:.3f} to {last:.3f} s"
    assert any(line.startswith(note) for line in found.notes)
    assert len(found.path) == 9
    chosen = {"frames": slice(3, None), "rotation": rotation}
    alone = mapping.map_recording(there, tiny_map_model(), **chosen)
    np.testing.assert_array_equal(found.radar.voxels, alone.radar.voxels)
    with pytest.raises(UsageError, match="none of 2 frames, from .* is within the po"):
        mapping.map_recording(there, tiny_map_model(), frames=slice(2))


def test_poses_that_jump_too_far_are_refused(recording):
    steps = np.full(FRAMES + 1, 0.1)
    steps[7] = 9.0
    with pytest.raises(UsageError, match=r"jump by 9.0 m in 0.1 s after frame 6"):
        mapped(recording, steps)


def test_heights_are_above_the_start_wherever_the_world_begins(recording):
    low, high = mapped(recording, 0.1), mapped(recording, 0.1, height_m=30.0)
    rise = np.array([0, 0, 200])  # voxels of 0.15 m
    moved = {tuple(v) for v in (high.enhanced.voxels - rise).tolist()}
    kept = moved & {tuple(v) for v in low.enhanced.voxels.tolist()}
    assert len(kept) > 0.95 * len(low.enhanced.voxels) > 0


def walls(frames, stop_at=None):
    """Clouds of a wall, one after another; Ctrl-C comes while one is made."""
    for number in range(frames):
        if number == stop_at:
            os.kill(os.getpid(), signal.SIGINT)
        yield np.column_stack([np.full(50, 5.0), np.linspace(-2, 2, 50), np.zeros(50)])


@pytest.fixture
def heard():
    """Ctrl-C raises KeyboardInterrupt, as in a terminal."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_loops_without_their_libraries_end_before_the_walk(recording, monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    done = []
    with pytest.raises(ImportError, match=r"needs gtsam: pip .*jradar\[loops\]"):
        mapping.map_recording(
            recording, tiny_map_model(), loops=True, advance=done.append
        )
    assert not done


@pytest.mark.parametrize("loops", [False, True])
def test_ctrl_c_ends_the_walk_and_keeps_what_is_mapped(heard, loops):
    poses = np.tile(np.eye(4), (9, 1, 1))
    poses[:, 0, 3] = 0.5 * np.arange(9)
    model, handler = tiny_map_model(), signal.getsignal(signal.SIGINT)
    found = mapping.map_clouds(walls(9, stop_at=3), poses, model, loops=loops)
    assert found.interrupted and len(found.path) == 4
    assert found.notes[0] == "interrupted: the map shows 4 of 9 frames"
    alone = mapping.map_clouds(walls(4), poses[:4], model)
    np.testing.assert_array_equal(found.enhanced.voxels, alone.enhanced.voxels)
    assert not alone.interrupted and signal.getsignal(signal.SIGINT) is handler


def test_a_second_ctrl_c_ends_the_mapping():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), first_interrupt_noted() as noted:
            os.kill(os.getpid(), signal.SIGINT)
            assert noted
            os.kill(os.getpid(), signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_ctrl_c_that_is_left_to_another_process_is_not_noted():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with first_interrupt_noted() as noted:
            os.kill(os.getpid(), signal.SIGINT)
        assert not noted
    finally:
        signal.signal(signal.SIGINT, before)
