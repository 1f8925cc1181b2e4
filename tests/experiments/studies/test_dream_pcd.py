"""DREAM-PCD's frames, by a sequence whose points are known."""

import numpy as np
import pytest

from experiments.studies.dream_pcd import main, read_frames
from jradar.mapping import save_map_model
from tests.models import tiny_map_model


@pytest.fixture
def sequence(tmp_path):
    """Twelve frames of a radar that moves forward, along DREAM-PCD's y."""
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (12, 1, 1))
    poses[:, 1, 3] = np.linspace(0, 2, 12)
    angle = 0.3  # to the left
    poses[6:, :2, :2] = [
        [np.cos(angle), -np.sin(angle)],
        [np.sin(angle), np.cos(angle)],
    ]
    ids = np.arange(5, 17)
    frame = np.repeat(ids, 40)
    points = np.zeros((len(frame), 10), np.float32)
    points[:, :3] = rng.uniform((-2, 3, -1), (2, 6, 1), (len(frame), 3))
    path = tmp_path / "walk.npz"
    np.savez(path, points=points, frame=frame, frame_ids=ids, world_from_radar=poses)
    return path


def test_clouds_are_forward_and_left_of_the_radar(sequence):
    clouds, poses = read_frames(sequence)
    with np.load(sequence) as file:
        x, y, z = file["points"][file["frame"] == 5][:, :3].T
        later = file["points"][file["frame"] == 16][:, :3]
    np.testing.assert_allclose(clouds[0], np.stack([y, -x, z], -1), atol=1e-6)
    np.testing.assert_allclose(poses[-1, :3, 3], [2, 0, 0], atol=1e-12)
    # After the turn to the left, what is straight ahead in the world is to the right.
    away = later - (0, 2, 0)
    bearing = np.arctan2(-away[:, 0], away[:, 1])
    np.testing.assert_allclose(
        np.arctan2(clouds[-1][:, 1], clouds[-1][:, 0]), bearing - 0.3, atol=1e-6
    )


def test_a_sequence_becomes_maps(sequence, tmp_path, capsys):
    save_map_model(tmp_path / "model", tiny_map_model())
    flags = [str(sequence), "--model", f"{tmp_path}/model", "-o", f"{tmp_path}/out"]
    assert main(flags) == 0
    assert "radar voxels" in capsys.readouterr().out
    assert (tmp_path / "out" / "map.png").stat().st_size > 5_000


def test_a_file_without_poses_is_named(tmp_path, capsys):
    np.savez(tmp_path / "some.npz", points=np.zeros((3, 10)), frame=np.zeros(3))
    assert main([f"{tmp_path}/some.npz", "-o", f"{tmp_path}/out"]) != 0
    assert "world_from_radar" in capsys.readouterr().err
