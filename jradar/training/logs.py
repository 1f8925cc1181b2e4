"""What a run writes: `metrics.jsonl`, TensorBoard if it is installed, the model card.

`metrics.jsonl` holds a line for each step. Lines of steps that run again are dropped,
so that a resumed run writes the same lines as an uninterrupted one.
"""

import contextlib
import importlib
import json
import math
import platform
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import jax

from jradar import __version__
from jradar.files import write_text

LIBRARIES = ("jax", "jaxlib", "flax", "optax", "orbax-checkpoint", "numpy")

Log = Callable[[int, dict[str, float]], None]


@contextlib.contextmanager
def step_log(workdir: Path | str, *, first: int) -> Iterator[Log]:
    """Yield `write(step, values)` for steps from `first` on; one process writes.

    A value that is not finite is written as null, which every JSON reader accepts.
    """
    if jax.process_index():
        yield lambda step, values: None
        return
    path = Path(workdir) / "metrics.jsonl"
    _drop_lines_from(path, first)
    with path.open("a", buffering=1) as file, _tensorboard(workdir, first) as show:

        def write(step, values):
            shown = {k: v if math.isfinite(v) else None for k, v in values.items()}
            file.write(json.dumps({"step": step, **shown}) + "\n")
            show(step, values)

        yield write


@contextlib.contextmanager
def _tensorboard(workdir, first):
    """Yield `show(step, values)`; it does nothing without tensorboardX."""
    try:
        writer_of = importlib.import_module("tensorboardX").SummaryWriter
    except ImportError:
        yield lambda step, values: None
        return
    with writer_of(str(Path(workdir) / "tensorboard"), purge_step=first) as writer:

        def show(step, values):
            for name, value in values.items():
                writer.add_scalar(name, value, step)

        yield show


def _drop_lines_from(path, step):
    """Keep the lines of the steps before `step`; drop an incomplete last line."""
    if not path.exists():
        return
    kept = []
    for line in path.read_text(errors="replace").splitlines():
        try:
            if json.loads(line)["step"] < step:
                kept.append(line + "\n")
        except (ValueError, KeyError, TypeError):
            break
    write_text(path, "".join(kept))


def write_model_card(
    workdir: Path | str,
    *,
    config: dict[str, Any],
    data_digest: str,
    seed: int,
    steps: int,
    purpose: str = "",
) -> None:
    """Write `model_card.json` into a run's folder; `data_digest` is of its data."""
    versions = {"jradar": __version__, "python": platform.python_version()}
    versions |= {name: metadata.version(name) for name in LIBRARIES}
    card = {
        "purpose": purpose,
        "seed": seed,
        "steps": steps,
        "data_digest": data_digest,
        "versions": versions,
        "devices": f"{jax.device_count()} x {jax.devices()[0].device_kind}",
        "config": config,
    }
    write_text(Path(workdir) / "model_card.json", json.dumps(card, indent=2) + "\n")
