"""Scoring: a row for each frame, method and truth; empty clouds; times; the file."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.evaluation import read_scores, score_frames, summarise, write_scores
from jradar.types import PointCloud
from tests.evaluation import invented

WALL = np.stack(np.meshgrid([5.0], np.arange(8.0), np.arange(4.0)), -1).reshape(-1, 3)
EMPTY = PointCloud(jnp.zeros((3, 3)), jnp.zeros(3, bool))
FRAMES = [WALL, WALL + [1, 0, 0]]


def cloud(xyz):
    return PointCloud.from_xyz(xyz)


def score(methods, *, truths=None, frames=FRAMES, **options):
    options |= {"truths": truths or {"LiDAR": lambda xyz: xyz}, "scene": "Hall"}
    return [*score_frames(jax.random.key(0), frames, methods, **options)]


def test_perfect_far_and_empty_methods():
    rows = score(
        {
            "none": lambda key, xyz: EMPTY,
            "perfect": lambda key, xyz: cloud(xyz),
            "far": lambda key, xyz: cloud(xyz + [0.3, 0, 0]),
        }
    )
    assert {row["scene"] for row in rows} == {"Hall"}
    assert [(r["method"], r["frame"]) for r in rows[:4]] == [
        ("none", 0), ("perfect", 0), ("far", 0), ("none", 1)
    ]  # fmt: skip
    none, perfect, far = rows[3:]
    assert np.isnan(none["chamfer"]) and np.isnan(none["modified_hausdorff"])
    assert none["points"] == 0 and none["f_score_0.5"] == 0
    assert perfect["chamfer"] == 0 and perfect["f_score_0.1"] == 1
    assert perfect["points"] == perfect["truth_points"] == 32
    assert far["chamfer"] == pytest.approx(0.6, rel=1e-4)
    assert far["modified_hausdorff"] == pytest.approx(0.3, rel=1e-4)
    assert far["f_score_0.2"] == 0 and far["f_score_0.5"] == 1


def test_empty_frames_leave_distances_and_lower_the_f_score():
    def every_other(key, xyz):
        return cloud(xyz) if xyz[0, 0] == 5 else EMPTY

    (mean,) = summarise(score({"a": every_other}))
    assert mean["chamfer"].mean == 0 and mean["chamfer"].frames == 1
    assert mean["f_score_0.2"].mean == 0.5 and mean["f_score_0.2"].frames == 2
    assert (mean["frames"], mean["empty"], mean["no_truth"]) == (2, 1, 0)


def test_frames_without_a_truth_are_left_out():
    truths = {"LiDAR": lambda xyz: xyz if xyz[0, 0] == 5 else xyz[:0]}
    rows = score({"a": lambda key, xyz: EMPTY}, truths=truths)
    assert np.isnan(rows[1]["f_score_0.2"]) and rows[1]["truth_points"] == 0
    (mean,) = summarise(rows)
    assert (mean["frames"], mean["empty"], mean["no_truth"]) == (1, 1, 1)


def test_several_truths_see_the_same_cloud():
    keys = []

    def noisy(key, xyz):
        keys.append(jax.random.key_data(key).tolist())
        return cloud(xyz + np.asarray(jax.random.normal(key, xyz.shape)))

    near, far = {}, {}
    truths = {"LiDAR": lambda xyz: xyz, "moved": lambda xyz: xyz + [9, 0, 0]}
    for row in score({"a": noisy, "b": noisy}, truths=truths):
        {"LiDAR": near, "moved": far}[row["truth"]][row["method"], row["frame"]] = row
    assert near.keys() == far.keys() and len(near) == 4
    for place, row in near.items():
        assert row["chamfer"] < far[place]["chamfer"]
        assert row["milliseconds"] == far[place]["milliseconds"]
    assert near["a", 1]["chamfer"] == near["b", 1]["chamfer"]
    assert len({tuple(key) for key in keys}) == 2


@pytest.mark.parametrize("by_size", [False, True])
def test_the_first_call_is_not_timed(monkeypatch, by_size):
    """Nor is the first one of each size of frames."""
    now, waits = 0.0, [10.0, 0.02, *[10.0] * by_size, 0.02]
    monkeypatch.setattr("time.perf_counter", lambda: now)

    def slow_at_first(key, xyz):
        nonlocal now
        now += waits.pop(0)
        return cloud(xyz)

    sizes = {"size": len} if by_size else {}
    rows = score({"a": slow_at_first}, frames=[WALL, WALL[:9]], **sizes)
    times = [row["milliseconds"] for row in rows]
    assert not waits and times == pytest.approx([20, 20])


def test_scores_come_back_from_their_file(tmp_path):
    rows = score({"none": lambda key, xyz: EMPTY, "all": lambda key, xyz: cloud(xyz)})
    write_scores(tmp_path / "frames.jsonl", rows)
    text = (tmp_path / "frames.jsonl").read_text()
    assert "NaN" not in text and '"chamfer": null' in text
    np.testing.assert_equal(read_scores(tmp_path / "frames.jsonl"), rows)


GOOD = invented.row("Hall", "", 0, "LiDAR", "a", 2.0)


@pytest.mark.parametrize(
    "line, message",
    [
        ('{"scene": "Hall"', "line 2: .*evaluate again"),
        ("[1]", r"\[1\] is not a JSON object"),
        (json.dumps(GOOD), "lines 1 and 2 score the same frame: Hall"),
        (json.dumps({k: GOOD[k] for k in GOOD if k != "truth"}), "lacks truth"),
        (json.dumps(GOOD | {"cd": 1}), "unknown fields cd"),
        (json.dumps(GOOD | {"frame": -1}), "frame is -1"),
        (json.dumps(GOOD | {"points": True}), "points is True"),
        (json.dumps(GOOD | {"method": None}), "method is None, expected a name"),
        (json.dumps(GOOD | {"chamfer": float("inf")}), "chamfer is inf"),
        (json.dumps(GOOD | {"chamfer": "2"}), "chamfer is '2', expected 0 .. inf"),
        (json.dumps(GOOD | {"f_score_0.2": 44.0}), "f_score_0.2 is 44.0, .* 0 .. 1"),
    ],
)
def test_a_damaged_file_of_scores_is_refused(tmp_path, line, message):
    path = tmp_path / "frames.jsonl"
    path.write_text(f"{json.dumps(GOOD)}\n{line}\n")
    with pytest.raises(ValueError, match=message):
        read_scores(path)


def test_an_empty_file_of_scores_is_refused(tmp_path):
    (tmp_path / "frames.jsonl").touch()
    with pytest.raises(ValueError, match="holds no scores"):
        read_scores(tmp_path / "frames.jsonl")
