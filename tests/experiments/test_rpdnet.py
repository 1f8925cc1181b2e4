"""RPDNet's task: it resumes from its checkpoint, learns, and writes its row."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import rpdnet, train
from experiments.build import build_optimizer
from experiments.configs import rpdnet as default
from experiments.evaluate import view_of
from experiments.rpdnet import labels as rpdnet_labels
from experiments.rpdnet.labels import LabelledMaps
from experiments.rpdnet.loss import make_rpdnet_step, rpdnet_params
from jradar import data, evaluation, training


@pytest.fixture
def config(records):
    config = default.get_config()
    config.data.path = str(records)
    config.network.update(channels=4, levels=3)
    config.train.update(steps=6, batch_size=4, warmup_steps=1, ema_decay=0.5)
    config.train.update(checkpoint_every=2, evaluate_every=6)
    config.evaluation.update(frames_for_limit=2, frames_while_training=2, every=1)
    return config


def test_a_run_ends_with_its_row_and_resumes_from_its_checkpoint(
    config, tmp_path, capsys
):
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
    state = training.TrainState(
        jnp.zeros((), jnp.int32), params, params, optimizer.init(params)
    )
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

    limit, score = rpdnet.choose_limit(view_of(frames), probability, frames, frames=1)
    assert limit in (0.25, 0.35, 0.5, 0.6) and score > 0


def test_frames_without_a_trajectory_are_left_out(records, monkeypatch):
    frames = data.Records(records, "train")
    items = LabelledMaps(frames, min_snr_db=3.0)
    assert len(items) == len(frames)
    assert items[0].condition.shape == items[0].target.shape == (16, 64, 1)
    assert 0 < items[0].target.mean() < 0.5
    velocities = np.full((len(frames), 3), np.nan)
    velocities[3] = 0.0
    monkeypatch.setattr(rpdnet_labels, "record_velocities", lambda _: velocities)
    assert len(LabelledMaps(frames, min_snr_db=3.0)) == 1
    velocities[:] = np.nan
    with pytest.raises(ValueError, match="no frame with a known velocity"):
        LabelledMaps(frames, min_snr_db=3.0)
