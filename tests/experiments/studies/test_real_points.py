"""Truth that other frames saw, and scores of a walk of points against it."""

from pathlib import Path

import numpy as np
import pytest

from experiments.studies import real_points
from jradar.errors import UsageError
from jradar.evaluation import read_scores
from jradar.model import save_model
from jradar.range_image import ImageSpec
from tests.models import one_pass_model

AHEAD, ASIDE, BEHIND = [5.0, 0, 0], [5.0, 1, 0], [-5.0, 0, 0]
VIEW = ImageSpec(8, 16, (-1.0, 1.0), (-0.3, 0.3), 12.0)


def walk(folder: Path, *frames):
    """A CSV of frames of points, and poses that move 0.1 m ahead in each."""
    lines = ["frame,timestamp,x,y,z,doppler"]
    for k, points in enumerate(frames):
        for x, y, z in np.subtract(points, [0.1 * k, 0, 0]):
            lines.append(f"{k},{0.1 * k},{x},{y},{z},0.0")
    (folder / "walk.csv").write_text("\n".join(lines) + "\n")
    poses = (f"{0.1 * k} {0.1 * k} 0 0 0 0 0 1" for k in range(-1, len(frames) + 1))
    (folder / "walk.tum").write_text("\n".join(poses) + "\n")
    return folder / "walk.csv"


def test_the_truth_of_a_frame_is_what_two_others_saw(tmp_path):
    seen = [AHEAD, ASIDE, BEHIND], [AHEAD, BEHIND], [AHEAD, ASIDE, BEHIND], [AHEAD]
    recording = real_points.open_recording(walk(tmp_path, *seen))
    voxels = real_points.hits(recording)
    poses = real_points._poses(recording, recording.points.stamps)

    def truth(frame, count):
        found = real_points._truth(voxels, poses, frame, count, VIEW)
        return found + [0.1 * frame, 0, 0]  # in the world

    np.testing.assert_allclose(truth(1, 1), [AHEAD, ASIDE], atol=0.08)
    np.testing.assert_allclose(truth(0, 1), [AHEAD], atol=0.08)  # ASIDE by one other
    np.testing.assert_allclose(truth(1, 2), [AHEAD], atol=0.08)  # 0 and 1 are joined
    assert not len(truth(3, 3))


def test_without_poses_there_is_no_truth(tmp_path):
    path = walk(tmp_path, [AHEAD], [AHEAD])
    (tmp_path / "walk.tum").unlink()
    with pytest.raises(UsageError, match="expected a radar's points, and poses"):
        real_points.hits(real_points.open_recording(path))


@pytest.mark.slow
def test_each_number_of_frames_is_scored(tmp_path):
    rng = np.random.default_rng(0)
    wall = rng.uniform([4, -2, -1], [5, 2, 1], (60, 3))
    save_model(tmp_path / "model", one_pass_model())
    out, path = tmp_path / "out", walk(tmp_path, *[wall] * 12)
    model = str(tmp_path / "model")
    assert real_points.main([str(path), "-o", str(out), "--model", model]) == 0
    rows = read_scores(out / "frames.jsonl")
    assert {row["method"] for row in rows} == {"radar points", "splat", model}
    assert {row["scene"] for row in rows} == {"1 frame", "5 frames", "10 frames"}
    own = [r for r in rows if (r["method"], r["scene"]) == ("radar points", "1 frame")]
    # A middle of a voxel is at most 0.13 m from a point in it.
    assert min(row["f_score_0.2"] for row in own) == 1
    assert "splat" in (out / "table.md").read_text()
    assert (out / "clouds.png").stat().st_size > 10_000
