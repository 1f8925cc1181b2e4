"""The training that all tasks share; a task fills in what differs.

A task is a module of `experiments`, named in `main.TASKS`, with three functions:

    check(config)                raises UsageError for a mistake, before anything starts
    setup(config, workdir)       returns a Training, or None to train nothing
    evaluate(config, workdir)    scores what the workdir holds, and prints the result

A run trains, saves, writes the model card and evaluates. Started again, it resumes.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
from ml_collections import ConfigDict

from experiments.build import TRAIN_KEY, random_key
from jradar import training
from jradar.errors import UsageError
from jradar.files import read_json, write_text

WRITTEN = ("metrics.jsonl", "retries.json", "checkpoints", "model_card.json")


class Training(NamedTuple):
    """What a task trains."""

    state: training.TrainState  # before the first step
    step: Callable[..., Any]  # (state, key, batch) -> (state, metrics)
    batch_at: Callable[[int], training.Batch]
    validate: Callable[[training.TrainState, int], dict[str, float]]
    save: Callable[[training.TrainState], None]
    trained_on: str  # shown to the user: "2304 frames"
    data_digest: str


def run(
    task: Any,
    config: ConfigDict,
    workdir: Path,
    *,
    recorded: ConfigDict | None = None,
    evaluate: bool = True,
) -> None:
    """Train and evaluate a task in a workdir that no other config has used.

    Several processes train together; the first one validates, saves and evaluates.
    The config that was `recorded` in the workdir may be another (see `stages`).
    """
    if config.data.path and not Path(config.data.path).exists():
        raise UsageError(f"data.path = {config.data.path}: no such file or folder")
    task.check(config)
    check_workdir(recorded or config, workdir)
    job = task.setup(config, workdir)
    if job is not None:
        print(f"training on {job.trained_on}", file=sys.stderr, flush=True)

        def validate(state, step):
            first = not jax.process_index()
            return job.validate(jax.device_get(state), step) if first else {}

        state = training.train(
            random_key(config, TRAIN_KEY),
            job.state,
            job.step,
            job.batch_at,
            steps=config.train.steps,
            workdir=workdir,
            data_digest=job.data_digest,
            checkpoint_every=config.train.checkpoint_every,
            evaluate_every=config.train.evaluate_every,
            evaluate=validate,
        )
        if jax.process_index():
            return
        job.save(state)
        training.write_model_card(
            workdir,
            config=(recorded or config).to_dict(),
            data_digest=job.data_digest,
            seed=config.seed,
            steps=config.train.steps_before + config.train.steps,
            purpose=config.purpose,
        )
    if evaluate:
        task.evaluate(config, workdir)


def check_workdir(config: ConfigDict, workdir: Path) -> None:
    """Record the config in the workdir.

    Raises UsageError if another config is there, or files that are not of a run.
    """
    path = workdir / "config.json"
    if not path.exists():
        if foreign := [name for name in WRITTEN if (workdir / name).exists()]:
            raise UsageError(
                f"{workdir} holds {foreign[0]} but no config.json, so no run of jradar "
                "wrote it: choose another --workdir"
            )
        write_text(path, config.to_json(indent=2) + "\n")
        return
    wanted, found = flat(json.loads(config.to_json())), flat(read_json(path))
    changed = sorted(k for k in wanted | found if wanted.get(k) != found.get(k))
    if changed:
        key = changed[0]
        raise UsageError(
            f"{workdir} was started with another config: {key} was {found.get(key)}, "
            f"now {wanted.get(key)} ({len(changed)} fields differ); choose another "
            "--workdir"
        )


def flat(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Return nested dictionaries as one, with dotted keys."""
    if not isinstance(tree, dict):
        return {prefix: tree}
    return {
        dotted: value
        for key, item in tree.items()
        for dotted, value in flat(item, f"{prefix}.{key}".lstrip(".")).items()
    }
