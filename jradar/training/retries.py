"""Steps whose loss or gradient was not finite, and the noise of their next attempt.

The failed step gets another key, and training returns to the last checkpoint. The key
of a step depends only on how often that step has failed before:

    step_key(key, retries) = key                            first attempt
                             fold_in(key, retries)          each one after it

and the step folds in its own number. All other steps repeat exactly, so the numbers of
a run do not depend on its checkpoints or on how often it is resumed. `retries.json`
lists the failed steps.
"""

import json
import math
from pathlib import Path

import jax
import numpy as np
from absl import logging
from jaxtyping import Array, Key

from jradar.data import Batch
from jradar.files import read_json, write_text

MAX_RETRIES = 3


class NotFinite(Exception):
    """The loss or the gradient of a step was not finite."""

    def __init__(self, step: int, name: str, value: float):
        self.step, self.reason = step, f"{name} is {value} at step {step}"
        super().__init__(self.reason)


def step_key(key: Key[Array, ""], retries: int) -> Key[Array, ""]:
    """Return the key of a step that has failed `retries` times."""
    return jax.random.fold_in(key, retries) if retries else key


def check_finite(step: int, values: dict[str, float]) -> None:
    """Raise NotFinite for the first value that is not finite.

    The gradient is checked too: otherwise the next step's loss would fail, and that
    step's noise is not the cause.
    """
    for name, value in values.items():
        if not math.isfinite(value):
            raise NotFinite(step, name, value)


def read_retries(workdir: Path | str) -> list[int]:
    """Return the steps that have failed so far, repeated for each failure."""
    path = Path(workdir) / "retries.json"
    if not path.exists():
        return []
    steps = read_json(path).get("steps")
    if not isinstance(steps, list) or not all(type(step) is int for step in steps):
        raise ValueError(f"{path} has steps = {steps!r:.80}, expected whole numbers")
    return steps


def note_retry(
    key: Key[Array, ""],
    fault: NotFinite,
    retries: list[int],
    batch: Batch,
    *,
    workdir: Path | str,
) -> list[int]:
    """Record a failed step, and return all failed steps.

    Raises FloatingPointError after MAX_RETRIES, or if the batch itself is not finite.
    """
    seed = np.asarray(jax.random.key_data(key)).tolist()
    where = f"{fault.reason}, key {seed}, retry {retries.count(fault.step)}"
    if not all(np.isfinite(array).all() for array in jax.tree.leaves(batch)):
        raise FloatingPointError(
            f"{where}: its batch holds values that are not finite; correct the data"
        )
    if len(retries) >= MAX_RETRIES:
        raise FloatingPointError(
            f"{where}: returned {len(retries)} times to a checkpoint, at steps "
            f"{retries}; lower the learning rate. The last checkpoint is kept"
        )
    logging.warning("%s: returning to the last checkpoint, with other noise", where)
    retries = [*retries, fault.step]
    if jax.process_index() == 0:
        write_text(Path(workdir) / "retries.json", json.dumps({"steps": retries}))
    return retries
