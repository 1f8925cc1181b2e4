"""RPDNet: labels by hand and by the simulator, losses, the critic, a whole run."""

import functools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import rpdnet, train
from experiments.build import build_optimizer
from experiments.configs import rpdnet as default
from experiments.rpdnet import labels as module, loss
from experiments.rpdnet.labels import LabelledMaps, label_cells
from experiments.rpdnet.loss import (
    focal_loss,
    make_rpdnet_step,
    rpdnet_loss,
    rpdnet_params,
)
from experiments.rpdnet.network import RPDNet
from jradar import data, evaluation, training
from jradar.evaluation import records_in_view
from jradar.radar import Radar, RadarSpec, Scatterers, all_cells, simulate_cube

KEY = jax.random.key(0)
RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
SMALL = RPDNet(channels=4, levels=2)


@pytest.fixture
def config(records):
    config = default.get_config()
    config.data.path = str(records)
    config.network.update(channels=4, levels=2)
    config.train.update(steps=6, batch_size=4, warmup_steps=1, ema_decay=0.5)
    config.train.update(checkpoint_every=2, evaluate_every=6)
    config.evaluation.update(frames_for_limit=2, frames_while_training=2, every=1)
    return config


@pytest.mark.slow
def test_a_run_ends_with_its_row_and_resumes(config, tmp_path, capsys):
    train.run(rpdnet, config, tmp_path)
    scores = evaluation.read_scores(tmp_path / "evaluation" / "frames.jsonl")
    assert {row["method"] for row in scores} == {"RPDNet"}
    assert len(scores) == 4  # two frames against two truths
    assert "cells of probability" in capsys.readouterr().out
    lines = (tmp_path / "metrics.jsonl").read_text().splitlines()
    values = [json.loads(line) for line in lines]
    assert values[-1]["validation/limit"] in rpdnet.LIMITS
    assert all(v["loss"] >= v["focal"] > 0 for v in values)
    weights = tmp_path / "weights.safetensors"
    before, table = weights.read_bytes(), tmp_path / "evaluation" / "table.md"
    first = table.read_text()
    weights.unlink()
    train.run(rpdnet, config, tmp_path)
    assert weights.read_bytes() == before and table.read_text() == first


@pytest.mark.slow
def test_it_learns_a_mask_that_a_threshold_cannot_give(config):
    # Valid cells are in the left half of the map and no stronger than the others.
    rng = np.random.default_rng(0)
    maps = rng.uniform(0, 1, (4, 16, 16, 1)).astype(np.float32)
    labels = (maps > 0.7) & (np.arange(16) < 8)[:, None]
    batch = training.Batch(jnp.asarray(maps), jnp.asarray(labels, jnp.float32))
    detector = rpdnet.build_detector(config)
    config.train.update(learning_rate=2e-2, steps=150)
    optimizer = build_optimizer(config.train)
    params = rpdnet_params(jax.random.key(0, impl="rbg"), detector, (16, 16))
    state = training.state_of(params, optimizer)
    step = make_rpdnet_step(detector, optimizer, adversarial=0.0, ema_decay=0.5)
    for _ in range(150):
        state, _ = step(state, jax.random.key(0), batch)
    logits = detector.apply(state.params["detector"], batch.condition)
    assert ((np.asarray(logits) > 0) == labels).mean() > 0.95
    thresholds = np.linspace(0, 1, 21)[:, None, None, None, None]
    assert ((maps > thresholds) == labels).mean((1, 2, 3, 4)).max() < 0.9


def test_the_limit_with_the_best_score_is_chosen(records):
    frames = data.Records(records, "validation")
    power = frames[0].cells.power
    strong = power > 30 * np.median(power)

    def probability(_):
        return np.where(strong, 0.65, 0.2)

    limit, score = rpdnet.choose_limit(
        records_in_view(frames), probability, frames, frames=1
    )
    assert limit in (0.25, 0.35, 0.5, 0.6) and score > 0


def test_frames_without_a_velocity_are_left_out(records, monkeypatch):
    frames = data.Records(records, "train")
    items = LabelledMaps(frames, min_snr_db=3.0)
    assert len(items) == len(frames)
    assert items[0].condition.shape == items[0].target.shape == (16, 64, 1)
    assert 0 < items[0].target.mean() < 0.5
    velocities = np.full((len(frames), 3), np.nan)
    velocities[3] = 0.0
    monkeypatch.setattr(module, "record_velocities", lambda _: velocities)
    assert len(LabelledMaps(frames, min_snr_db=3.0)) == 1
    velocities[:] = np.nan
    with pytest.raises(ValueError, match="no frame with a known velocity"):
        LabelledMaps(frames, min_snr_db=3.0)


def test_maps_of_the_commonest_size_are_trained_on(records, monkeypatch):
    class Mixed(data.Records):
        def __getitem__(self, i):
            frame = super().__getitem__(i)
            power = frame.cells.power[: 8 if i == 0 else None]
            return frame._replace(cells=frame.cells._replace(power=power))

    frames = Mixed(records, "train")
    still = np.zeros((len(frames), 3))
    monkeypatch.setattr(module, "record_velocities", lambda _: still)
    items = LabelledMaps(frames, min_snr_db=3.0)
    assert len(items) == len(frames) - 1
    assert {item.condition.shape for item in items} == {(16, 64, 1)}


@pytest.mark.slow
def test_doppler_gives_the_radars_own_velocity(records):
    velocity, random = np.array([0.6, 0.2, 0.0]), np.random.default_rng(0)
    sine = random.uniform(-0.8, 0.8, 24)
    away = np.stack([np.sqrt(1 - sine**2), sine, np.zeros(24)], -1)
    scatterers = Scatterers(
        jnp.asarray(random.uniform(1, 9, (24, 1)) * away, jnp.float32),
        jnp.asarray(-away @ velocity, jnp.float32),
        jnp.ones(24),
    )
    cube = simulate_cube(KEY, scatterers, RADAR, noise_power=1e-4)
    frames = data.Records(records, "train")
    view = records_in_view(frames)._replace(records=_OfOneRadar(frames))
    frame = frames[0]._replace(cells=all_cells(cube, Radar(RADAR)))
    found = module.doppler_velocity(frame, view)
    np.testing.assert_allclose(found, velocity, atol=0.03)


class _OfOneRadar:
    """Records that are all of RADAR."""

    def __init__(self, records):
        self.windows_of = records.windows_of

    def radar_of(self, sequence):
        return RADAR


def test_the_label_lies_where_the_radar_sees_a_static_point():
    velocity = np.array([0.6, 0.2, 0.0])
    points = np.array([[3.0, 0.4, 0.1], [1.5, -1.0, 0.0], [2.0, 2.0, 0.3]])
    for point in points:
        receding = -(point @ velocity) / np.linalg.norm(point)
        scatterer = Scatterers(
            jnp.asarray(point[None], jnp.float32),
            jnp.asarray(receding[None], jnp.float32),
            jnp.ones(1),
        )
        cube = simulate_cube(KEY, scatterer, RADAR, noise_power=1e-4)
        power = np.asarray(all_cells(cube, Radar(RADAR)).power)
        label = label_cells(point[None], velocity, power, RADAR)
        strongest = np.unravel_index(power.argmax(), power.shape)
        assert label[strongest] and 1 <= label.sum() <= 9


def test_labels_need_power_and_wrap_around_in_velocity():
    power, step = np.ones((16, 32)), RADAR.velocity_resolution_mps
    ahead = np.array([[10 * RADAR.range_resolution_m, 0, 0]])
    assert not label_cells(ahead, np.zeros(3), power, RADAR).any()
    power[8, 10] = power[7, 10] = 10.0
    expected = np.zeros(power.shape, bool)
    expected[[7, 8], 10] = True
    for cells in (0, 16, -32):
        velocity = np.array([cells * step, 0, 0])
        found = label_cells(ahead, velocity, power, RADAR)
        np.testing.assert_array_equal(found, expected)
    bias = 3 * RADAR.range_resolution_m
    nearer = ahead - np.array([[bias, 0, 0]])
    biased = label_cells(nearer, np.zeros(3), power, RADAR, range_bias_m=bias)
    np.testing.assert_array_equal(biased, expected)
    beyond = np.array([[40 * RADAR.range_resolution_m, 0, 0], [0, 0, 0]])
    assert not label_cells(beyond, np.zeros(3), power, RADAR).any()


def test_focal_loss_is_cross_entropy_for_gamma_0_and_the_formula_otherwise():
    logits, labels = jnp.array([2.0, -1.0, 0.5]), jnp.array([1.0, 0.0, 0.0])
    right = jax.nn.sigmoid(jnp.where(labels > 0, logits, -logits))
    for gamma in (0.0, 2.0):
        expected = (-((1 - right) ** gamma) * np.log(right)).mean()
        found = focal_loss(logits, labels, gamma=gamma)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


@functools.cache
def gradient_of(weight):
    """The loss, its parts and their gradient; compiled once for each weight."""
    value = functools.partial(rpdnet_loss, SMALL, weight=weight)
    return jax.jit(jax.value_and_grad(value, has_aux=True))


@pytest.fixture(scope="module")
def params():
    """Parameters of a small detector and a critic of two layers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loss, "Critic", functools.partial(loss.Critic, widths=(4, 4)))
        yield rpdnet_params(jax.random.key(0, impl="rbg"), SMALL, (16, 16))


@pytest.mark.slow
def test_detector_descends_the_distance_that_the_critic_climbs(params):
    maps = jax.random.uniform(KEY, (2, 16, 16, 1))
    labels = (maps > 0.9).astype(jnp.float32)
    (plain, _), without = gradient_of(0.0)(params, maps, labels)
    (value, parts), both = gradient_of(0.5)(params, maps, labels)
    np.testing.assert_allclose(value, plain + 0.5 * parts["distance"], rtol=1e-5)
    assert all((leaf == 0).all() for leaf in jax.tree.leaves(without["critic"]))
    pull = jax.tree.map(np.subtract, both["detector"], without["detector"])
    assert max(abs(leaf).max() for leaf in jax.tree.leaves(pull)) > 1e-5
    moved = jax.tree.map(lambda p, g: p - 1e-2 * g, params["critic"], both["critic"])
    (_, after), _ = gradient_of(0.5)({**params, "critic": moved}, maps, labels)
    assert after["distance"] > parts["distance"]


def test_a_perfect_mask_is_at_no_distance(params):
    maps = jnp.ones((2, 16, 16, 1))
    nothing = jax.tree.map(jnp.zeros_like, params["detector"])
    for bias, distance in ((20.0, 0.0), (-20.0, 0.1)):
        nothing["params"]["logits"]["bias"] = jnp.array([bias])
        changed = {**params, "detector": nothing}
        (_, parts), _ = gradient_of(0.5)(changed, maps, maps)
        assert (parts["distance"] == 0) == (distance == 0)
        assert parts["distance"] >= distance
