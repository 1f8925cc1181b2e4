"""Training: exact resumption, digests, torn logs, NaN, signals, EMA."""

import json
import os
import signal

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jradar.diffusion import NoiseSpec, UNet
from jradar.training import (
    Batch,
    Checkpoints,
    Interrupted,
    TrainState,
    create_state,
    make_train_step,
    train,
)

NETWORK = UNet(channels=4, multipliers=(1,), blocks=1, attention_levels=(), stem=(1, 2))
NOISE, OPTIMIZER = NoiseSpec(), optax.adam(1e-2)
STEP = make_train_step(NETWORK, OPTIMIZER, NOISE, ema_decay=0.9)
KEY = jax.random.key(3)


def batch_at(step):
    rng = np.random.default_rng(step)
    return Batch(
        rng.normal(size=(4, 8, 8, 2)).astype(np.float32),
        0.5 * rng.normal(size=(4, 8, 16, 2)).astype(np.float32),
    )


@pytest.fixture(scope="module")
def start():
    return create_state(
        jax.random.key(0, impl="rbg"),
        NETWORK,
        OPTIMIZER,
        image_shape=(8, 16, 2),
        condition_shape=(8, 8, 2),
    )


def run(start, workdir, steps, **options):
    workdir.mkdir(exist_ok=True)
    return train(
        KEY, start, STEP, options.pop("batch_at", batch_at), steps=steps,
        workdir=workdir, checkpoint_every=2, **options,
    )  # fmt: skip


def losses(workdir):
    lines = (workdir / "metrics.jsonl").read_text().splitlines()
    return [(line["step"], line["loss"]) for line in map(json.loads, lines)]


def assert_equal_trees(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)


def test_resumed_run_equals_the_uninterrupted_one(start, tmp_path):
    whole = run(start, tmp_path / "a", 7)
    run(start, tmp_path / "b", 4)
    resumed = run(start, tmp_path / "b", 7)
    assert_equal_trees(resumed, whole)
    assert losses(tmp_path / "b") == losses(tmp_path / "a")
    assert [step for step, _ in losses(tmp_path / "a")] == [*range(7)]


def test_lines_after_the_checkpoint_are_run_again_and_torn_ones_dropped(
    start, tmp_path
):
    run(start, tmp_path, 4)
    expected = losses(tmp_path)
    path = tmp_path / "metrics.jsonl"
    path.write_text(path.read_text() + '{"step": 4, "loss": 9.0}\n{"step": 5, "lo')
    run(start, tmp_path, 4)
    assert losses(tmp_path) == expected


def test_finished_run_is_left_alone(start, tmp_path):
    done = run(start, tmp_path, 3)
    assert_equal_trees(run(start, tmp_path, 3), done)


def test_loss_falls_and_average_follows(start, tmp_path):
    fixed = batch_at(0)
    state = run(start, tmp_path, 60, batch_at=lambda step: fixed)
    values = [loss for _, loss in losses(tmp_path)]
    assert np.mean(values[-20:]) < 0.92 * np.mean(values[:20])
    kernels = [
        tree["params"]["trunk"]["stem"]["kernel"]
        for tree in (start.params, state.ema_params, state.params)
    ]
    steps = [jnp.abs(a - b).max() for a, b in zip(kernels, kernels[1:], strict=False)]
    assert steps[0] > steps[1] > 0  # the average has left the start behind


def test_damaged_checkpoint_is_passed_over(start, tmp_path, caplog):
    run(start, tmp_path, 4)
    whole = losses(tmp_path)
    _damage(tmp_path / "checkpoints" / "4")
    run(start, tmp_path, 4)
    assert "checkpoint of step 4 is not usable" in caplog.text
    assert losses(tmp_path) == whole


def test_empty_newest_step_is_passed_over(start, tmp_path):
    whole = run(start, tmp_path, 4)
    (tmp_path / "checkpoints" / "9").mkdir()
    assert_equal_trees(run(start, tmp_path, 4), whole)


def test_only_damaged_checkpoints_is_an_error(start, tmp_path):
    run(start, tmp_path, 2)
    _damage(tmp_path / "checkpoints" / "2")
    kept = sorted((tmp_path / "checkpoints").rglob("*"))
    with pytest.raises(ValueError, match=r"none of the checkpoints \[2\] is usable"):
        run(start, tmp_path, 2)
    assert sorted((tmp_path / "checkpoints").rglob("*")) == kept


def _damage(folder):
    """Flip a bit in the largest file below a folder."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    largest = max(files, key=lambda path: path.stat().st_size)
    content = bytearray(largest.read_bytes())
    content[len(content) // 2] ^= 1
    largest.write_bytes(content)


def test_loss_that_is_not_finite_stops_and_keeps_the_checkpoint(start, tmp_path):
    def poisoned(step):
        batch = batch_at(step)
        return batch if step < 3 else batch._replace(target=batch.target * np.nan)

    with pytest.raises(FloatingPointError, match="loss is nan at step 3"):
        run(start, tmp_path, 6, batch_at=poisoned)
    state = Checkpoints(tmp_path / "checkpoints").restore(start)
    assert state is not None and int(state.step) == 2
    assert np.isfinite(state.params["params"]["trunk"]["stem"]["kernel"]).all()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_saves_and_the_run_goes_on(start, tmp_path, number):
    def interrupting(step):
        if step == 2:
            os.kill(os.getpid(), number)
        return batch_at(step)

    with pytest.raises(Interrupted, match="saved at step 3") as stop:
        run(start, tmp_path / "a", 6, batch_at=interrupting)
    assert stop.value.exit_code == 128 + number
    assert_equal_trees(run(start, tmp_path / "a", 6), run(start, tmp_path / "b", 6))


def test_state_is_a_plain_tree(start):
    assert isinstance(start, TrainState) and int(start.step) == 0
    assert_equal_trees(start.params, start.ema_params)
