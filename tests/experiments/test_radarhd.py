"""RadarHD's task on invented rooms: training, limits and the table."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import radarhd, train
from experiments.configs import (
    radarhd as default,
    radarhd_nearness,
    radarhd_regression,
)
from experiments.radarhd import (
    methods as radarhd_methods,
    report as radarhd_report,
    scores as radarhd_scores,
)
from experiments.radarhd.occupancy import agreed_occupancy
from experiments.radarhd.pairs import LIDAR, RADAR, PolarItems, open_radarhd
from experiments.weights import load_weights
from jradar.errors import ModelError, UsageError


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """A straight wall at another distance in each frame, also seen by the radar."""
    path = tmp_path_factory.mktemp("radarhd") / "pairs.npz"
    radar, lidar, keys = [], [], []
    for trajectory in (1, 136, 137, 138, 140):
        for frame in range(2):
            row = 60 + 20 * frame + trajectory % 7
            wall = np.zeros(LIDAR.shape, bool)
            wall[row] = True
            echo = np.zeros(RADAR.shape, np.uint8)
            echo[row - 1 : row + 2] = 200
            radar.append(echo)
            lidar.append(np.packbits(wall, axis=-1))
            keys.append((trajectory, frame))
    trajectory, frame = np.array(keys).T
    np.savez(
        path,
        radar=np.stack(radar),
        lidar_packed=np.stack(lidar),
        trajectory=trajectory,
        frame=frame,
    )
    return path


def small(module, path):
    config = module.get_config()
    config.data.update(path=str(path), every=1)
    for network in (config.network, config.nearness.network):
        network.update(
            channels=8, multipliers=(1,), attention_levels=(), condition_channels=8
        )
    config.train.update(steps=3, batch_size=2, checkpoint_every=2, evaluate_every=2)
    config.train.warmup_steps = 1
    config.sampling.update(steps=2, draws=2, batch_size=2)
    return config


@pytest.mark.parametrize(
    "module",
    [
        default,
        radarhd_nearness,
        pytest.param(radarhd_regression, marks=pytest.mark.slow),
    ],
)
def test_a_run_ends_with_its_table_and_weights_are_scored_elsewhere(
    module, packed, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(radarhd_scores, "LIMITS", radarhd_scores.LIMITS[4::10])
    config = small(module, packed)
    train.run(radarhd, config, tmp_path)
    table = (tmp_path / "evaluation" / "table.md").read_text()
    names = {
        "diffusion": [
            *("one-step estimate", "one pass from zero"),
            *("diffusion, iPNDM 2", "2 draws"),
        ],
        "nearness": ["| one pass |", "one pass and its mirror image"],
        "regression": ["direct regression"],
    }
    for name in names[config.method]:
        assert name in table
    assert "138, 140" in table and table in capsys.readouterr().out
    assert "## Confidence of Cartesian cells" in table
    confidence = json.loads((tmp_path / "evaluation" / "confidence.json").read_text())
    assert all(f"| {name} |" in table for name in confidence) and confidence
    assert (tmp_path / "evaluation" / "samples.png").stat().st_size > 5000
    assert (tmp_path / "weights.safetensors").stat().st_size < 2e6
    assert (tmp_path / "model_card.json").is_file()
    elsewhere = tmp_path / "elsewhere"
    with pytest.raises(ModelError, match="no weights at .*elsewhere"):
        radarhd.evaluate(config, elsewhere)
    config.weights = str(tmp_path / "weights.safetensors")
    radarhd.evaluate(config, elsewhere)
    assert (elsewhere / "evaluation" / "table.md").read_text() == table
    config.data.turn = 20.0
    radarhd.evaluate(config, elsewhere)
    turned = (elsewhere / "evaluation" / "table.md").read_text()
    assert "not trained on, turned by 20 degrees" in turned


def test_a_run_starts_from_weights_with_changed_and_simulated_pairs(packed, tmp_path):
    config = small(default, packed)
    config.train.steps = 1
    start = radarhd.setup(config, tmp_path)
    start.save(start.state._replace(ema_params=doubled(start.state.params)))
    config.train.initial = str(tmp_path / "weights.safetensors")
    config.train.augment = ("scale", "turn", "gain", "speckle", "drop", "paste")
    config.data.update(simulated=str(packed), simulated_share=0.5)
    training = radarhd.setup(config, tmp_path)
    for wanted, found in zip(
        jax.tree.leaves(doubled(start.state.params)),
        jax.tree.leaves(training.state.params),
        strict=True,
    ):
        np.testing.assert_allclose(found, wanted, rtol=2e-3, atol=1e-3)  # float16
    assert "and 10 simulated ones, 1 of 2" in training.trained_on
    batch = training.batch_at(0)
    assert batch.condition.shape == (2, *RADAR.shape, 1)
    assert set(np.unique(batch.target)) <= {0.0, 1.0}
    again = training.batch_at(0)
    np.testing.assert_array_equal(batch.condition, again.condition)
    config.data.simulated = ""
    with pytest.raises(UsageError, match="no simulated pairs: pass them"):
        radarhd.check(config)


def doubled(params):
    return jax.tree.map(lambda values: 2 * values, params)


def test_wrong_fields_are_named(packed):
    config = small(default, packed)
    config.data.threshold_trajectories = (136, 9)
    with pytest.raises(UsageError, match="config.data.threshold_trajectories: no tr"):
        radarhd.setup(config, packed.parent)
    config.data.threshold_trajectories = (136, 137)
    start = radarhd.setup(config, packed.parent)
    start.save(start.state)
    config.data.update(turn=120.0, every=1)
    with pytest.raises(UsageError, match="config.data.turn: 120 degrees, expected -90"):
        radarhd.evaluate(config, packed.parent)
    config.weights = "nowhere"
    with pytest.raises(UsageError, match="weights = nowhere: no such file"):
        radarhd.evaluate(config, packed.parent)
    config.method = "guess"
    with pytest.raises(UsageError, match="method = 'guess', expected one of"):
        radarhd.check(config)
    config.noise.sigma_data = 0.6
    with pytest.raises(UsageError, match="config.noise: sigma_data = 0.6, expected"):
        radarhd.check(config)


def test_the_limit_with_the_best_mean_is_chosen():
    rows = [
        {"protocol": "polar", "method": "a", "limit": limit, "f_score_0.2": score}
        for limit, scores in ((0.1, (0.9, 0.1)), (0.5, (0.6, 0.6)), (0.9, (0.0, 0.9)))
        for score in scores
    ]
    assert radarhd_scores.choose_limits(rows) == {"polar": {"a": 0.5}}


def test_frames_without_points_follow_one_rule():
    truth = np.array([[1.0, 0.0, 0.0]])

    def row(found, truth, frame):
        scores = radarhd_scores.plane_scores(found, truth)
        place = {"method": "a", "trajectory": 1, "frame": frame}
        return {**place, "points": len(found), **scores}

    empty = np.empty((0, 3))
    rows = [
        row(truth + [0.3, 0, 0], truth, 0),
        row(empty, truth, 1),
        row(empty, truth, 2),
        row(truth, empty, 3),
    ]
    assert np.isnan(rows[1]["chamfer"]) and rows[1]["f_score_0.5"] == 0
    assert np.isnan(rows[3]["f_score_0.5"])
    means = radarhd_scores.mean_scores(rows[:3])
    assert means["chamfer"] == pytest.approx(0.3)
    assert means["f_score_0.5"] == pytest.approx(1 / 3)
    assert means["empty"] == pytest.approx(2 / 3)
    head, _, line, _, note, _ = radarhd_report.markdown(rows, {"a": 0.5}).split("\n")
    cells = dict(zip(head.split(" | "), line.split(" | "), strict=True))
    assert cells["Chamfer (m)"].startswith("0.300") and cells["frames"] == "3"
    assert cells["F 0.5 m (%)"].startswith("33.3") and line.endswith("| 2 |")
    assert "in which the method found points" in note
    assert "1 frames with an empty truth are left out" in note


def test_draws_that_agree_are_those_of_the_sampler(packed):
    config = small(default, packed)
    pairs = open_radarhd(packed)
    params = radarhd.setup(config, packed.parent).state.params
    condition = jnp.asarray(PolarItems(pairs, history=1)[0].condition)[None]
    methods, key = radarhd_methods.draw_methods(config, params), jax.random.key(3)
    network, noise = radarhd_methods.networks(config)
    draws = [
        radarhd_methods.draw_images(
            key, condition, params=params, network=network, noise=noise, steps=8
        )
        for key in jax.random.split(key, 2)
    ]
    expected = agreed_occupancy(jnp.stack(draws))
    found = methods["2 draws"](key, condition)
    np.testing.assert_array_equal(found, expected)
    assert set(np.unique(found)) <= {0.0, 0.5, 1.0}
    assert "2 draws and nearness" not in methods
    config.sampling.draws = 1
    assert "1 draws" not in radarhd_methods.draw_methods(config, params)


def test_draws_are_averaged_with_nearness_and_drawn_once(packed, tmp_path, monkeypatch):
    config, other = small(default, packed), small(radarhd_nearness, packed)
    other.data.history = 1
    params = radarhd.setup(config, tmp_path).state.params
    training = radarhd.setup(other, tmp_path)
    training.save(training.state)
    config.nearness.weights = str(tmp_path / "weights.safetensors")
    drawn, draw = [], radarhd_methods.agreed_images

    def counted(*arguments):
        drawn.append(arguments)
        return draw(*arguments)

    monkeypatch.setattr(radarhd_methods, "agreed_images", counted)
    methods, key = radarhd_methods.draw_methods(config, params), jax.random.key(3)
    condition = jnp.asarray(PolarItems(open_radarhd(packed), history=1)[0].condition)
    condition = condition[None]
    share = methods["2 draws"](key, condition)
    both = methods["2 draws and nearness"](key, condition)
    assert len(drawn) == 1
    near = radarhd_methods.draw_methods(
        other, load_weights(Path(config.nearness.weights))
    )
    wanted = near["one pass and its mirror image"](key, condition)
    np.testing.assert_allclose(both, (share + wanted) / 2, atol=1e-6)
    methods["2 draws"](jax.random.key(4), condition)
    assert len(drawn) == 2
    config.data.history = 2
    with pytest.raises(ModelError, match="data.history = 2: .*differ"):
        radarhd_methods.draw_methods(config, params)
    config.nearness.weights = "nowhere"
    with pytest.raises(UsageError, match="weights = nowhere: no such file"):
        radarhd.evaluate(config, tmp_path)
