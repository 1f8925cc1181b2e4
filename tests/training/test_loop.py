"""The loop: exact resumption, torn logs, retries, signals, evaluation."""

import functools
import json
import os
import signal
import sys
from unittest import mock

import jax
import numpy as np
import pytest

from jradar.errors import CheckpointError
from jradar.training import train
from jradar.training.checkpoints import Checkpoints
from jradar.training.loop import Interrupted
from tests.training import tiny
from tests.training.tiny import STEP, batch_at

KEY = jax.random.key(tiny.KEY_SEED)


@pytest.fixture(scope="module")
def start():
    return tiny.new_state()


@pytest.fixture(autouse=True)
def no_tensorboard(monkeypatch):
    """It imports PyTorch where that is installed."""
    monkeypatch.setitem(sys.modules, "tensorboardX", None)


def run(start, workdir, steps, **options):
    workdir.mkdir(exist_ok=True)
    given = {"key": KEY, "step": STEP, "batch_at": batch_at, "checkpoint_every": 2}
    given |= options
    return train(
        given.pop("key"), start, given.pop("step"), given.pop("batch_at"),
        steps=steps, workdir=workdir, **given,
    )  # fmt: skip


def lines(workdir):
    text = (workdir / "metrics.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


def losses(workdir):
    return [(line["step"], line["loss"]) for line in lines(workdir)]


def assert_equal_trees(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)


def by_hand(start, steps, *, retries=()):
    """Do the same steps in a plain loop; those in `retries` have failed before."""
    state = start
    for step in range(steps):
        count = [*retries].count(step)
        key = jax.random.fold_in(KEY, count) if count else KEY
        state, _ = STEP(state, key, batch_at(step))
    return state


def test_loop_does_the_steps_and_nothing_else(start, tmp_path):
    assert_equal_trees(run(start, tmp_path, 5), by_hand(start, 5))
    assert [line["step"] for line in lines(tmp_path)] == [*range(5)]
    assert all(line["seconds"] >= 0 for line in lines(tmp_path))


def test_a_run_of_no_steps_leaves_the_state_as_it_is(start, tmp_path):
    assert_equal_trees(run(start, tmp_path, 0).params, start.params)


def test_resumed_run_equals_the_uninterrupted_one(start, tmp_path):
    whole = run(start, tmp_path / "a", 7)
    for steps in (1, 2, 5):
        run(start, tmp_path / "b", steps)
    assert_equal_trees(run(start, tmp_path / "b", 7), whole)
    assert losses(tmp_path / "b") == losses(tmp_path / "a")
    assert_equal_trees(run(start, tmp_path / "b", 7), whole)  # left as it is


def test_lines_after_the_checkpoint_run_again_and_torn_ones_drop(start, tmp_path):
    run(start, tmp_path, 4)
    expected = losses(tmp_path)
    path = tmp_path / "metrics.jsonl"
    path.write_text(path.read_text() + '{"step": 4, "loss": 9.0}\n{"step": 5, "lo')
    run(start, tmp_path, 4)
    assert losses(tmp_path) == expected


def test_another_key_or_other_data_are_refused(start, tmp_path):
    run(start, tmp_path, 2, data_digest="abc")
    for options, message in (
        ({"key": jax.random.key(4)}, r"another run: key was \[0, 3\], now \[0, 4\]"),
        ({"data_digest": "def"}, "another run: data was abc, now def"),
    ):
        with pytest.raises(CheckpointError, match=message):
            run(start, tmp_path, 4, **{"data_digest": "abc"} | options)
    run(start, tmp_path, 4, data_digest="abc")


def failing(*, steps, times, what="loss"):
    """The step, whose loss or gradient is NaN in its first `times` attempts."""
    keys = [KEY, *(jax.random.fold_in(KEY, n) for n in range(1, times))][:times]
    bad = [jax.random.key_data(key).tolist() for key in keys]
    name = {"loss": "loss", "gradient": "gradient_norm"}[what]

    def step(state, key, batch):
        after, metrics = STEP(state, key, batch)
        if int(state.step) in steps and jax.random.key_data(key).tolist() in bad:
            params = jax.tree.map(lambda x: x * np.nan, after.params)
            after = after._replace(params=params)
            metrics[name] = np.float32(np.nan)
        return after, metrics

    return step


@pytest.mark.parametrize("what", ["loss", "gradient"])
def test_step_that_fails_is_run_again_with_other_noise(start, tmp_path, what):
    state = run(start, tmp_path, 6, step=failing(steps=[3], times=1, what=what))
    assert_equal_trees(state, by_hand(start, 6, retries=[3]))
    assert [step for step, _ in losses(tmp_path)] == [*range(6)]
    assert json.loads((tmp_path / "retries.json").read_text()) == {"steps": [3]}
    both = state, by_hand(start, 6)
    assert not np.array_equal(*(jax.tree.leaves(s.params)[1] for s in both))


@pytest.mark.parametrize("checkpoint_every", [3, 100])
def test_where_checkpoints_lie_changes_no_retries(start, tmp_path, checkpoint_every):
    step = functools.partial(run, step=failing(steps=[1, 4], times=1))
    for steps in (3, 5, 6):  # resumed before, between and after the failures
        state = step(start, tmp_path, steps, checkpoint_every=checkpoint_every)
    assert_equal_trees(state, by_hand(start, 6, retries=[1, 4]))


def test_step_that_keeps_failing_stops_and_is_named(start, tmp_path, caplog):
    step = failing(steps=[3], times=9)
    message = r"loss is nan at step 3, key \[0, 3\], retry 3: returned 3 times"
    for _ in range(2):  # the same command fails in the same way
        with pytest.raises(FloatingPointError, match=message):
            run(start, tmp_path, 6, step=step)
    assert caplog.text.count("returning to the last checkpoint") == 3
    state = Checkpoints(tmp_path / "checkpoints", run={"key": [0, 3]}).restore(start)
    assert_equal_trees(state, by_hand(start, 2))


def test_batch_that_is_not_finite_is_not_tried_again(start, tmp_path):
    def poisoned(step):
        batch = batch_at(step)
        return batch if step < 3 else batch._replace(target=batch.target * np.nan)

    with pytest.raises(FloatingPointError, match="step 3.* its batch holds values"):
        run(start, tmp_path, 6, batch_at=poisoned)
    assert not (tmp_path / "retries.json").exists()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_saves_and_the_run_resumes(start, tmp_path, number):
    def interrupting(step):
        if step == 2:
            os.kill(os.getpid(), number)
        return batch_at(step)

    with pytest.raises(Interrupted, match="saved at step 3") as stop:
        run(start, tmp_path, 6, batch_at=interrupting)
    assert stop.value.exit_code == 128 + number
    assert_equal_trees(run(start, tmp_path, 6), by_hand(start, 6))


def test_a_second_signal_ends_the_process_at_once(start, tmp_path, monkeypatch):
    def end(number):
        raise SystemExit(128 + number)

    def impatient(step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
            os.kill(os.getpid(), signal.SIGTERM)
        return batch_at(step)

    monkeypatch.setattr(signal, "raise_signal", end)
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit, match="143"):
        run(start, tmp_path, 6, batch_at=impatient, checkpoint_every=1)
    assert signal.getsignal(signal.SIGTERM) == before
    assert_equal_trees(run(start, tmp_path, 6), by_hand(start, 6))


@pytest.mark.parametrize("text", ["{", "[]", '{"steps": "many"}', '{"steps": ["1"]}'])
def test_a_damaged_file_of_retries_is_named(start, tmp_path, text):
    (tmp_path / "retries.json").write_text(text)
    with pytest.raises(ValueError, match="retries.json"):
        run(start, tmp_path, 2)


def test_evaluation_is_logged(start, tmp_path):
    values = {2: 0.5, 4: 0.1, 6: float("nan"), 8: 0.3, 9: 0.4}
    calls = []

    def evaluate(state, step):
        assert int(state.step) == step
        calls.append(step)
        return {"chamfer": values[step], "f_score": 1.0}

    run(start, tmp_path, 9, evaluate=evaluate, evaluate_every=2)
    assert calls == [*values]
    found = {
        line["step"] + 1: line.get("validation/chamfer", 0) for line in lines(tmp_path)
    }
    expected = {step: values.get(step, 0) for step in range(1, 10)}
    assert found == expected | {6: None}


def test_tensorboard_gets_every_value(start, tmp_path, monkeypatch):
    package = mock.MagicMock()
    monkeypatch.setitem(sys.modules, "tensorboardX", package)
    run(start, tmp_path, 1)
    run(start, tmp_path, 2)
    folder, open_writer = str(tmp_path / "tensorboard"), package.SummaryWriter
    opened = [mock.call(folder, purge_step=step) for step in (0, 1)]
    assert open_writer.call_args_list == opened
    writer = open_writer.return_value
    assert writer.__exit__.call_count == 2
    added = writer.__enter__.return_value.add_scalar.call_args_list
    names = ("loss", "gradient_norm", "seconds")
    found = [(call.args[0], call.args[2]) for call in added]
    assert found == [(name, step) for step in (0, 1) for name in names]
