"""Steps whose loss or gradient was not finite, and with which noise they are run again.

The step that failed gets another key, and training goes back to the last checkpoint.
The key of a step depends on nothing but how often that step has failed before:

    step_key(key, retries) = key                            first attempt
                             fold_in(key, retries)          each one after it

and the step folds in its own number. All other steps repeat what they did, so where the
checkpoints lie, or how often the run is resumed, does not change its numbers. The steps
that failed stand in `retries.json`.
"""

import json
import math
from pathlib import Path

import jax
import numpy as np
from absl import logging
from jaxtyping import Array, Key

from jradar.files import write_text
from jradar.training.step import Batch

MAX_RETRIES = 3


class NotFinite(Exception):
    """A value of a step was not finite."""

    def __init__(self, step: int, name: str, value: float):
        """The first such step, and the name of its value."""
        self.step, self.reason = step, f"{name} is {value} at step {step}"
        super().__init__(self.reason)


def step_key(key: Key[Array, ""], retries: int) -> Key[Array, ""]:
    """The key of a step that has failed `retries` times."""
    return jax.random.fold_in(key, retries) if retries else key


def check_finite(step: int, values: dict[str, float]) -> None:
    """Raise NotFinite for the first value that is not.

    The gradient counts too: where only it is not finite, the next step's loss fails,
    and that step's noise is not to blame.
    """
    for name, value in values.items():
        if not math.isfinite(value):
            raise NotFinite(step, name, value)


def read_retries(workdir: Path | str) -> list[int]:
    """The steps that have failed so far, one of them several times maybe."""
    path = Path(workdir) / "retries.json"
    return json.loads(path.read_text())["steps"] if path.exists() else []


def note_retry(
    key: Key[Array, ""],
    fault: NotFinite,
    retries: list[int],
    batch: Batch,
    *,
    workdir: Path | str,
) -> list[int]:
    """The steps that have failed, with the new one, which is written down.

    Raises FloatingPointError after MAX_RETRIES, or where the batch itself is to blame.
    """
    seed = np.asarray(jax.random.key_data(key)).tolist()
    where = f"{fault.reason}, key {seed}, retry {retries.count(fault.step)}"
    if not all(np.isfinite(array).all() for array in jax.tree.leaves(batch)):
        raise FloatingPointError(
            f"{where}: its batch holds values that are not finite; mend the data"
        )
    if len(retries) >= MAX_RETRIES:
        raise FloatingPointError(
            f"{where}: went back {len(retries)} times, at steps {retries}; lower the "
            "learning rate; the last checkpoint is kept"
        )
    logging.warning("%s: going back to the last checkpoint, with other noise", where)
    retries = [*retries, fault.step]
    if jax.process_index() == 0:
        write_text(Path(workdir) / "retries.json", json.dumps({"steps": retries}))
    return retries
