"""Scores of the maps of a walk, on a corridor whose answers are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.studies import walk_maps
from experiments.studies.walk_maps import (
    SCORES,
    Scans,
    main,
    relocalised,
    scores,
    table,
)

VOXEL_M = 0.15
PATH_M = np.stack([np.linspace(0, 6, 20), np.zeros(20), np.zeros(20)], -1)


def box(x, y, z):
    return np.stack(np.meshgrid(x, y, z), -1).reshape(-1, 3)


WALLS = box(range(40), (-10, 10), range(-8, 9))
FREE = box(range(40), range(-9, 10), range(-2, 3))


def test_the_truth_has_full_marks():
    found = scores(WALLS, WALLS, FREE, PATH_M, VOXEL_M)
    assert found["f_15"] == found["f_30"] == 100
    assert found["closed"] == found["missed"] == 0


def test_a_wall_across_closes_its_columns_and_one_side_is_missed():
    left = WALLS[WALLS[:, 1] > 0]
    across = box((20,), range(-9, 10), range(-8, 9))
    found = scores(np.concatenate([left, across]), WALLS, FREE, PATH_M, VOXEL_M)
    assert found["closed"] == pytest.approx(100 * 19 / (40 * 19))
    # Of the right wall, columns within 0.3 m of the wall across are found.
    near = np.hypot(np.arange(40) - 20, 1) * VOXEL_M <= 0.3
    assert found["missed"] == pytest.approx(100 * (40 - near.sum()) / 80)


def test_what_is_above_the_robot_does_not_close_its_way():
    ceiling = box(range(40), range(-9, 10), (12,))
    found = scores(np.concatenate([WALLS, ceiling]), WALLS, FREE, PATH_M, VOXEL_M)
    assert found["closed"] == 0
    assert found["f_30"] < 100
    assert scores(WALLS[:0], WALLS, FREE, PATH_M, VOXEL_M)["missed"] == 100


def test_the_table_has_the_mean_of_the_walks():
    rows = [
        {"walk": name, "method": "some", "f_15": f, "f_30": f, "closed": 1, "missed": 2}
        | {"voxels": 10}
        for name, f in (("a", 40), ("b", 60))
    ]
    assert "| some | 2 | 50.0 | 50.0 | 1.0 | 2.0 | 10.0 |" in table(rows, SCORES)


def test_frames_are_placed_in_a_map_of_walls_and_not_in_an_empty_one():
    random = np.random.default_rng(0)
    flat = random.uniform(-3, 3, (3, 4000, 2))
    sides = np.full((4000, 1), 3.0)
    known = np.concatenate(
        [
            np.hstack([flat[0], -sides / 2]),
            np.hstack([sides, flat[1]]),
            np.hstack([flat[2, :, :1], sides, flat[2, :, 1:]]),
        ]
    )
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :2, 3] = random.uniform(-1, 1, (4, 2))
    clouds = [known[::7] - pose[:3, 3] for pose in poses]
    scans = Scans(poses, {"walls": clouds, "nothing": [np.zeros((0, 3))] * 4})
    found = relocalised(known, scans)
    assert found["walls"] < 0.02 and found["walls: height"] < 0.02
    assert 0.1 < found["nothing"] < 0.3  # where it started
    assert 0.02 < found["nothing: height"] < 0.3


@pytest.mark.parametrize("later", ["0", "21", "40"])
def test_a_later_walk_begins_within_the_recording(later, monkeypatch, tmp_path, capsys):
    walk = SimpleNamespace(path="walk", cubes=[None] * 40)
    monkeypatch.setattr(walk_maps, "open_recording", lambda path: walk)
    assert main(["walk", "-o", str(tmp_path / "out"), "--later", later]) == 2
    expected = f"--later {later}: walk has 40 frames, expected a number above 0"
    assert expected in capsys.readouterr().err
