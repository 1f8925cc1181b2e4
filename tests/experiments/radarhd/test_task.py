"""RadarHD's task on invented rooms: training, limits, the report, wrong fields."""

import json

import jax
import numpy as np
import pytest

from experiments import radarhd as task, train
from experiments.configs import radarhd as default, radarhd_history, radarhd_nearness
from experiments.radarhd import scores
from jradar.errors import ModelError, UsageError
from jradar.evaluation import read_scores
from jradar.model import PolarGrid, load_model
from jradar.model.grids.polar import RADAR
from tests.experiments.radarhd.conftest import shrink

METHODS = {
    (radarhd_history, "diffusion"): [
        "one-step estimate",
        "one pass from zero",
        "diffusion, iPNDM 2",
        "2 draws",
    ],
    (radarhd_nearness, "nearness"): ["one pass", "one pass and its mirror image"],
    (default, "regression"): ["direct regression"],
}


@pytest.mark.slow
@pytest.mark.parametrize(("module", "method"), METHODS)
def test_a_run_ends_with_its_tables_and_weights_are_scored_elsewhere(
    module, method, walls, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(scores, "LIMITS", scores.LIMITS[4::10])
    config = shrink(module.get_config(), walls)
    config.method = method
    simulated = method == "regression"
    if simulated:
        config.data.simulated = config.data.path
    train.run(task, config, tmp_path)
    out = tmp_path / "evaluation"
    tables = (out / "protocols.md").read_text()
    assert "138, 140" in tables and tables in capsys.readouterr().out
    rows = read_scores(out / "frames.jsonl")
    answers = METHODS[module, method]
    assert [*dict.fromkeys(row["method"] for row in rows)] == answers
    assert {row["truth"] for row in rows} == {"polar", "cartesian"}
    for name in ("samples.png", "worst.png", "report.html"):
        assert (out / name).stat().st_size > 5000
    assert (tmp_path / "model" / "weights.safetensors").stat().st_size < 2e6
    lines = (tmp_path / "metrics.jsonl").read_text().splitlines()
    assert 0 <= json.loads(lines[-1])["validation/f_score_0.2"] <= 1
    elsewhere = tmp_path / "elsewhere"
    model = load_model(tmp_path)
    assert model.card.steps_seen == 3
    assert model.spec.grid == PolarGrid(config.data.history)
    answer = {"regression": "occupancy"}.get(method, method)
    assert model.spec.method == answer
    assert ("simulated" in model.card.trained_on) == simulated
    config.model = str(tmp_path)
    task.evaluate(config, elsewhere)
    assert (elsewhere / "evaluation" / "protocols.md").read_text() == tables
    table = (elsewhere / "evaluation" / "confidence.md").read_text()
    assert "too sure by" in table and "112 to 140, building of the training" in table
    config.data.turn = 20.0
    task.evaluate(config, elsewhere)
    tables = (elsewhere / "evaluation" / "protocols.md").read_text()
    assert "not trained on, rotated by 20 degrees" in tables


@pytest.fixture(scope="module")
def started(walls, tmp_path_factory):
    """A small config, its training before the first step, and its weights."""
    workdir = tmp_path_factory.mktemp("started")
    config = shrink(default.get_config(), walls)
    training = task.setup(config, workdir)
    training.save(training.state)
    return training, workdir


@pytest.mark.slow
def test_a_run_starts_from_weights_with_varied_pairs(walls, started):
    start, workdir = started
    config = shrink(default.get_config(), walls)
    config.train.initial = str(workdir)
    config.train.varied = True
    config.seed = 1
    training = task.setup(config, workdir)
    for wanted, found in zip(
        *map(jax.tree.leaves, (start.state.params, training.state.params)), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=1e-3)  # float16
    batch = training.batch_at(0)
    assert batch.condition.shape == (2, *RADAR.shape, 1)
    assert set(np.unique(batch.target)) <= {0.0, 1.0}
    again = training.batch_at(0)
    np.testing.assert_array_equal(batch.condition, again.condition)


def test_a_model_that_does_not_fit_is_named(walls, started, tmp_path):
    config = shrink(default.get_config(), walls)
    with pytest.raises(ModelError, match="no model at"):
        task.evaluate(config, tmp_path)
    config.data.history = 3
    with pytest.raises(UsageError, match="expected PolarGrid.history=3.: change data"):
        task.evaluate(config, started[1])
    config.update(model="jradar-maps", nearness="nowhere")
    with pytest.raises(UsageError, match="jradar-maps sees ColumnGrid.* expected Pol"):
        task.evaluate(config, started[1])
    config.update(model="radarhd-nearness")
    config.data.history = 41
    with pytest.raises(UsageError, match="method 'nearness', expected one for 'diffus"):
        task.evaluate(config, started[1])
    config.update(model="")
    config.data.history = 1
    with pytest.raises(ModelError, match="no model at nowhere"):
        task.evaluate(config, started[1])


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("method", "guess", "method = 'guess', expected one of"),
        ("data.path", "", "no pairs: pass RadarHD's folder"),
        ("noise.sigma_data", 0.6, "config.noise: sigma_data = 0.6, expected"),
        ("data.threshold_trajectories", (136, 9), "config.data.threshold_traj.*: no t"),
        ("data.turn", 120.0, "config.data.turn: 120 degrees, expected -90"),
    ],
)
def test_wrong_fields_are_named(walls, started, field, value, message, monkeypatch):
    config = shrink(default.get_config(), walls)
    config.update_from_flattened_dict({field: value})
    monkeypatch.setattr(task, "score_pairs", lambda *_, **__: [])
    with pytest.raises(UsageError, match=message):
        task.check(config)
        task.evaluate(config, started[1])


def test_simulated_images_have_no_history(walls):
    config = shrink(radarhd_history.get_config(), walls)
    task.check(config)
    config.data.simulated = str(walls)
    with pytest.raises(UsageError, match="history = 41, expected 1 with data.simul"):
        task.check(config)
