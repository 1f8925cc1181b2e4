"""The loop around the step: progress, metrics, checkpoints, signals, evaluation.

A killed run, started again, resumes from its last checkpoint and ends with the numbers
of an uninterrupted one. Everything except the step itself runs on the host. At most two
steps are in flight: with more, several devices on few cores hang.
"""

import collections
import contextlib
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array, Key

from jradar.data import Batch
from jradar.progress import progress
from jradar.training.checkpoints import Checkpoints
from jradar.training.logs import step_log
from jradar.training.parallel import data_mesh, parallel_step, preempted, replicate
from jradar.training.retries import (
    NotFinite,
    check_finite,
    note_retry,
    read_retries,
    step_key,
)
from jradar.training.step import Step, TrainState

IN_FLIGHT = 2  # steps
SHOWN_MEAN = 100  # steps that the printed loss averages

Evaluate = Callable[[TrainState, int], dict[str, float]]


class Interrupted(Exception):
    """A signal ended training after the step's state was saved."""

    def __init__(self, signal_number: int, step: int):
        """`signal_number` is SIGINT or SIGTERM."""
        self.exit_code = 128 + signal_number
        super().__init__(f"interrupted: saved at step {step}, run again to resume")


def train(
    key: Key[Array, ""],
    state: TrainState,
    step: Step,
    batch_at: Callable[[int], Batch],
    *,
    steps: int,
    workdir: Path | str,
    data_digest: str = "",
    checkpoint_every: int = 500,
    evaluate_every: int = 0,
    evaluate: Evaluate | None = None,
) -> TrainState:
    """Train up to step `steps`, resuming from the workdir's last checkpoint.

    `batch_at` returns the whole batch of a step. A run that was started on data of
    another `data_digest` is refused with CheckpointError. Values of
    `evaluate(state, step)` go to metrics.jsonl as `validation/<name>`. After SIGTERM or
    SIGINT the state is saved, and Interrupted is raised. If a loss or a gradient is not
    finite, training returns to the last checkpoint (see `retries`); a fourth time
    raises FloatingPointError.
    """
    workdir, mesh = Path(workdir), data_mesh()
    seed = np.asarray(jax.random.key_data(key)).tolist()
    start, key = replicate((state, key), mesh)
    step = parallel_step(step, mesh)
    retries = read_retries(workdir)
    identity = {"key": seed} | ({"data": data_digest} if data_digest else {})
    checkpoints = Checkpoints(workdir / "checkpoints", run=identity)

    def run_from(state):
        first, pending = int(state.step), collections.deque()
        with (
            _signals() as caught,
            step_log(workdir, first=first) as write,
            progress("training", steps, first=first, unit="steps") as show,
        ):
            losses, before = collections.deque(maxlen=SHOWN_MEAN), time.monotonic()
            for index in range(first, steps):
                retried = step_key(key, retries.count(index))
                state, metrics = step(state, retried, batch_at(index))
                pending.append((index, metrics))
                done = index + 1
                stop = caught or ([signal.SIGTERM] if preempted(done) else [])
                judged = evaluate and _due(done, evaluate_every, steps)
                saved = judged or stop or _due(done, checkpoint_every, steps)
                for number, values in _finished(pending, 0 if saved else IN_FLIGHT - 1):
                    if evaluate and judged and number == index:
                        scores = evaluate(state, done)
                        values |= {f"validation/{k}": v for k, v in scores.items()}
                    now = time.monotonic()
                    write(number, values | {"seconds": round(now - before, 4)})
                    before = now
                    losses.append(values["loss"])
                    show(number + 1, f"loss {sum(losses) / len(losses):.4f}")
                if saved:
                    checkpoints.save(state)
                if stop:
                    raise Interrupted(stop[0], done)
        return state

    try:
        while True:
            try:
                return run_from(checkpoints.restore(start) or start)
            except NotFinite as fault:
                batch = batch_at(fault.step)
                retries = note_retry(key, fault, retries, batch, workdir=workdir)
    finally:
        checkpoints.close()


def _finished(pending, keep):
    """Yield steps with their checked values until `keep` are pending."""
    while len(pending) > keep:
        index, metrics = pending.popleft()
        names = sorted(metrics, key=lambda name: name != "loss")
        values = {name: float(metrics[name]) for name in names}
        check_finite(index, values)
        yield index, values


def _due(done, every, steps):
    return done == steps or (every > 0 and done % every == 0)


@contextlib.contextmanager
def _signals():
    """Collect SIGINT and SIGTERM in a list; a second one ends the process at once."""
    caught: list[int] = []
    elsewhere = threading.current_thread() is not threading.main_thread()
    if elsewhere or jax.process_count() > 1:  # several agree on a step: `preempted`
        yield caught
        return

    def handle(number, _):
        if caught:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        caught.append(number)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, handle) for number in numbers]
    try:
        yield caught
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
