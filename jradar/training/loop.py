"""The loop around the step: progress, metrics, checkpoints, signals.

`metrics.jsonl` holds a line for each step. A run that was killed goes on from its last
checkpoint when it is started again; lines of steps that are run once more are dropped,
so that the file reads like that of an uninterrupted run.
"""

import collections
import contextlib
import json
import math
import signal
import threading
from collections.abc import Callable
from pathlib import Path

from jaxtyping import Array, Key

from jradar.files import write_text
from jradar.progress import progress
from jradar.training.checkpoints import Checkpoints
from jradar.training.state import TrainState
from jradar.training.step import Batch, Step

SHOWN_MEAN = 100  # steps over which the shown loss is averaged


class Interrupted(Exception):
    """A signal ended training after the step's state was saved."""

    def __init__(self, signal_number: int, step: int):
        """`signal_number` is SIGINT or SIGTERM."""
        self.exit_code = 128 + signal_number
        super().__init__(f"interrupted: saved at step {step}, run again to go on")


def train(
    key: Key[Array, ""],
    state: TrainState,
    step: Step,
    batch_at: Callable[[int], Batch],
    *,
    steps: int,
    workdir: Path | str,
    checkpoint_every: int = 500,
) -> TrainState:
    """Run `step` until `steps`, resuming from the workdir's last checkpoint.

    `batch_at` gives the batch of a step. SIGTERM and SIGINT end the loop after the step
    in progress: the state is saved and Interrupted raised. Raises FloatingPointError
    where the loss is not finite; the last checkpoint stays.
    """
    workdir = Path(workdir)
    checkpoints = Checkpoints(workdir / "checkpoints")
    metrics_path = workdir / "metrics.jsonl"
    try:
        state = checkpoints.restore(state) or state
        first = int(state.step)
        _drop_lines_from(metrics_path, first)
        recent = collections.deque(maxlen=SHOWN_MEAN)
        with (
            _signals() as caught,
            metrics_path.open("a") as log,
            progress("training", steps, first=first, unit="steps") as show,
        ):
            for index in range(first, steps):
                state, metrics = step(state, key, batch_at(index))
                values = {name: float(value) for name, value in metrics.items()}
                log.write(json.dumps({"step": index, **values}) + "\n")
                if not math.isfinite(values["loss"]):
                    raise FloatingPointError(
                        f"loss is {values['loss']} at step {index}: lower the learning "
                        "rate; the last checkpoint is kept"
                    )
                recent.append(values["loss"])
                show(index + 1, f"loss {sum(recent) / len(recent):.4f}")
                last = index + 1 == steps or bool(caught)
                if last or (index + 1) % checkpoint_every == 0:
                    log.flush()
                    checkpoints.save(state)
                if caught:
                    raise Interrupted(caught[0], index + 1)
        return state
    finally:
        checkpoints.close()


def _drop_lines_from(path, step):
    """Keep the lines of the steps before `step`; a torn last line goes too."""
    if not path.exists():
        return
    kept = []
    for line in path.read_text().splitlines():
        try:
            if json.loads(line)["step"] < step:
                kept.append(line + "\n")
        except (ValueError, KeyError):
            break
    write_text(path, "".join(kept))


@contextlib.contextmanager
def _signals():
    """Collect SIGINT and SIGTERM in a list; a second one ends the process at once."""
    caught: list[int] = []
    if threading.current_thread() is not threading.main_thread():
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
