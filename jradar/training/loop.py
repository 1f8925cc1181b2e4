"""The loop around the step: progress, metrics, checkpoints, signals.

`metrics.jsonl` holds a line for each step. A run that was killed goes on from its last
checkpoint when it is started again; lines of steps that are run once more are dropped,
so that the file reads like that of an uninterrupted run.
"""

import contextlib
import fcntl
import json
import math
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxtyping import Array, Key

from jradar.files import write_text
from jradar.training.checkpoints import Checkpoints
from jradar.training.state import TrainState
from jradar.training.step import Batch, Step

SECONDS_BETWEEN_LINES = 10.0


class Interrupted(Exception):
    """A signal ended training after the step's state was saved."""

    def __init__(self, signal_number: int, step: int):
        """`signal_number` is SIGINT or SIGTERM."""
        self.exit_code = 128 + signal_number
        super().__init__(f"interrupted: saved at step {step}, run again to go on")


class WorkdirLocked(OSError):
    """Another process holds the workdir."""


@contextlib.contextmanager
def lock_workdir(workdir: Path | str) -> Iterator[None]:
    """Hold the workdir, which is made if need be; WorkdirLocked if another does."""
    path = Path(workdir) / ".lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise WorkdirLocked(f"another process is running in {workdir}") from error
        yield


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
        progress = _Progress(first, steps)
        with _signals() as caught, metrics_path.open("a") as log:
            for index in range(first, steps):
                state, metrics = step(state, key, batch_at(index))
                values = {name: float(value) for name, value in metrics.items()}
                log.write(json.dumps({"step": index, **values}) + "\n")
                if not math.isfinite(values["loss"]):
                    raise FloatingPointError(
                        f"loss is {values['loss']} at step {index}: lower the learning "
                        "rate; the last checkpoint is kept"
                    )
                progress.show(index + 1, values["loss"])
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


class _Progress:
    """A line on stderr: rewritten on a terminal, every ten seconds elsewhere."""

    def __init__(self, first, steps):
        self.first, self.steps = first, steps
        self.shown = -math.inf
        self.start = math.nan  # after the first step, which compiles
        self.recent: list[float] = []

    def show(self, done, loss):
        now = time.monotonic()
        if done == self.first + 1:
            self.start = now
        self.recent = [*self.recent[-99:], loss]
        terminal = sys.stderr.isatty()
        pause = 0.2 if terminal else SECONDS_BETWEEN_LINES
        if now - self.shown < pause and done != self.steps:
            return
        self.shown = now
        mean = sum(self.recent) / len(self.recent)
        line = f"step {done}/{self.steps}  loss {mean:.4f}"
        if now > self.start:
            rate = (done - self.first - 1) / (now - self.start)
            left = time.gmtime((self.steps - done) / rate)
            line += f"  {rate:.2f} steps/s  left {time.strftime('%H:%M:%S', left)}"
        end = "\n" if not terminal or done == self.steps else "\r"
        print(f"{line:<72}", end=end, file=sys.stderr, flush=True)
