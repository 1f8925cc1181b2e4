"""The study of confidence: all points count, rights by hand, tables and a figure."""

import dataclasses

import jax
import numpy as np
import pytest
from PIL import Image

from experiments import build
from experiments.configs import marginal, regression
from experiments.studies import reliability
from jradar import data
from jradar.errors import UsageError
from jradar.model import draw, load_model, save_model
from jradar.range_image import ConfidenceTable, unproject

KEY = jax.random.fold_in(jax.random.key(reliability.KEY), 0)  # of the first frame
CONSTANT = ConfidenceTable.of((0.25, 0.25), least=0.9)  # every point's confidence


@pytest.fixture(scope="module")
def model(made):
    """A random model that says 25 % of every point, and drops all by default."""
    _, model = made(marginal)
    return dataclasses.replace(model, confidence=CONSTANT)


def points(confidence, right, frames=1):
    return reliability.Points(np.array(confidence), np.array(right), frames)


def test_all_points_count_and_are_right_near_the_lidar(records, model):
    frames = data.Records(records, "test")
    found = reliability.drawn_points(model, frames, every=2)
    assert found.frames == 1
    condition = build.build_pairs(model.spec, frames)[0].condition
    image = draw(KEY, condition, model, least_confidence=0.0)
    cloud = unproject(image.range_m, model.spec.fine)
    xyz = np.asarray(cloud.xyz, float)[np.asarray(cloud.valid)]
    truth = frames[0].lidar_xyz.astype(float)
    squared = [((point - truth) ** 2).sum(-1).min() for point in xyz]
    right = np.sqrt(squared) <= 0.2
    assert len(right) > 500
    np.testing.assert_array_equal(found.right, right)
    np.testing.assert_allclose(found.confidence, 0.25)


def test_frames_without_lidar_points_are_left_out(records, model):
    frame = data.Records(records, "test")[0]
    empty = frame._replace(lidar_xyz=frame.lidar_xyz[:0])
    whole = reliability.drawn_points(model, [frame])
    found = reliability.drawn_points(model, [frame, empty])
    assert found.frames == whole.frames == 1
    np.testing.assert_array_equal(found.right, whole.right)
    with pytest.raises(UsageError, match="--model mine drew no points on 1 frames"):
        reliability.drawn_points(model, [empty], name="mine")


def test_the_command_writes_tables_and_a_figure(records, model, tmp_path, capsys):
    save_model(tmp_path / "model", model)
    out = tmp_path / "out"
    chosen = ["--records", str(records), "--model", str(tmp_path / "model")]
    assert reliability.main(["-o", str(out), *chosen, "--split", "validation"]) == 0
    text = (out / "reliability.md").read_text()
    assert text in capsys.readouterr().out
    saved = load_model(tmp_path / "model")  # rounded
    found = reliability.drawn_points(saved, data.Records(records, "validation"))
    right = found.right.mean()
    error = f"{100 * abs(right - 0.25):.1f}"
    first = text.splitlines()[2].split(" | ")
    assert first[2:7] == [
        "2", f"{len(found.right):,}", "25.0", f"{100 * right:.1f}", error,
    ]  # fmt: skip
    assert f"| 20 to 30 | {len(found.right):,} | 25.0 | {100 * right:.1f} |" in text
    assert "| 90 to 100 | 0 | – | – |" in text
    assert min(Image.open(out / "reliability.png").size) > 300
    assert reliability.main(["-o", str(out), *chosen, "--split", "nothing"]) == 4
    assert "split='nothing'" in capsys.readouterr().err
    assert reliability.main(["-o", str(out), *chosen, "--every", "0"]) == 2
    assert "--every 0, expected 1 or more" in capsys.readouterr().err


def test_a_model_without_confidence_is_refused(records, made, tmp_path, capsys):
    save_model(tmp_path / "plain", made(regression)[1])
    chosen = ["--records", str(records), "--model", str(tmp_path / "plain")]
    assert reliability.main(["-o", str(tmp_path / "out"), *chosen]) == 2
    assert "draws by regression, without confidence" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_row_for_each_folder_and_one_for_all_points():
    first = points([0.9, 0.9, 0.1], [True, False, False], frames=1)
    second = points([0.5], [True], frames=2)
    both = reliability.together([first, second])
    assert both.frames == 3 and both.right.tolist() == [True, False, False, True]
    found = {"a": first, "b": second, reliability.TOGETHER: both}
    text = reliability.report({("ours", name): part for name, part in found.items()})
    assert "| ours | a | 1 | 3 | 63.3 | 33.3 | 30.0 | 50.0 | 50.0 |" in text
    assert "| ours | b | 2 | 1 | 50.0 | 100.0 | 50.0 | 100.0 | 100.0 |" in text
    assert "| ours | all records | 3 | 4 | 60.0 | 50.0 | 35.0 | 50.0 | 50.0 |" in text
    assert text.count("## ") == 1 and "## ours, all records" in text
