"""Files of weights: those that training starts from, and those that a task saved."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from jradar import diffusion, training
from jradar.errors import ModelError, UsageError
from jradar.model import shipped_models

# Where a workdir, or the folder of a model, keeps its weights.
FILES = ("model/weights.safetensors", "weights.safetensors")


def initial_weights(train: ConfigDict) -> Path | None:
    """Return the file that `train.initial` names; None to start from random weights.

    Raises UsageError for an empty name, or for a folder without weights.
    """
    if train.initial is None:
        return None
    if not train.initial:
        raise UsageError(
            "no weights to start from: pass them as --config.train.initial=PATH"
        )
    return _found(Path(shipped_models().get(train.initial, train.initial)))


def _found(path: Path) -> Path:
    files = [path] if path.is_file() else [path / name for name in FILES]
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        raise UsageError(
            f"no weights at train.initial = {path}: expected a file, a model, a "
            f"shipped model, or the workdir of a run with one of {FILES}"
        )
    return found


def write_mean(path: Path, shares: Mapping[Path, float]) -> None:
    """Write the mean of the weights of workdirs, by the share of each.

    Raises UsageError if their networks differ.
    """
    trees = [diffusion.read_params(_found(folder)) for folder in shares]
    if len({str(diffusion.parameter_shapes(tree)) for tree in trees}) > 1:
        raise UsageError("config.stages: a mean is of stages with one network")

    def mean(*leaves):
        return sum(w * leaf for w, leaf in zip(shares.values(), leaves, strict=True))

    tree = jax.tree.map(mean, *trees)
    diffusion.write_params(path, tree, dtype=np.float32)


def start_from(
    train: ConfigDict, network: diffusion.Network, state: training.TrainState
) -> training.TrainState:
    """Return the state with the weights that `train.initial` names.

    Prints how many parameters were loaded, and which stay new.
    """
    path = initial_weights(train)
    if path is None:
        return state
    params, report = diffusion.load_pretrained(path, network, state.params)
    counts = {name: len(names) for name, names in report._asdict().items()}
    new = sorted({"/".join(name.split("/")[:2]) for name in report.new})
    print(
        f"starting from {path}: {counts['loaded']} parameters loaded, {counts['new']} "
        f"new {new}, {counts['unused']} in the file not used {[*report.unused]}",
        file=sys.stderr,
        flush=True,
    )
    return state._replace(params=params, ema_params=params)


def load_weights(path: Path) -> Any:
    """Return the parameters that a task saved. Raises ModelError without them."""
    if not path.is_file():
        raise ModelError(f"no weights at {path}: train first, without --mode=eval")
    return diffusion.read_params(path)
