"""Configs of several stages: one command makes weights from nothing.

    config.stages = (
        {"method": "regression", "train": {"steps": 14400}},
        {"train": {"steps": 1200}},
        {"train": {"steps": 3000}, "start": (0, 1)},
    )
    config.average = (0, 0.5, 0.5)

A stage is the config with these changes. It runs in WORKDIR/stage_0, WORKDIR/stage_1
and so on, and starts from the weights of the stage before, or from the mean of earlier
ones by the shares of `start`. The model in WORKDIR is the mean of all stages by the
shares of `average`, or else the last one. Stages whose records would be the same share
WORKDIR/data. The same command resumes: a stage with a model card is finished.
"""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments import build, train
from experiments.weights import write_mean
from jradar.errors import UsageError

STAGED = "enhance", "radarhd", "maps"  # tasks that start from weights
FREE = "network."  # further keys override fields of a preset


class Stage(NamedTuple):
    """One run of a staged config, and the mean of weights that it starts from."""

    folder: Path
    config: ConfigDict
    shares: Sequence[float] = ()  # of the stages before


def run(task: ModuleType, config: ConfigDict, workdir: Path) -> None:
    """Train and evaluate a config, stage by stage if it has stages."""
    if not config.get("stages"):
        train.run(task, config, workdir)
        return
    if jax.process_count() > 1:
        raise UsageError("config.stages: stages run in one process")
    stages = stages_of(config, workdir)
    for stage in stages:
        task.check(stage.config)
    train.check_workdir(config, workdir)
    if any(stage.config.data.path == str(_records(workdir)) for stage in stages):
        build.prepared_data(config, workdir)
    for stage in stages:
        last = stage.folder == workdir
        if last or not (stage.folder / "model_card.json").is_file():
            start = _start(stage, stages)
            recorded = config if last else start
            train.run(task, start, stage.folder, recorded=recorded, evaluate=last)


def final_config(config: ConfigDict, workdir: Path) -> ConfigDict:
    """Return the config by which a run's result is evaluated."""
    return stages_of(config, workdir)[-1].config if config.get("stages") else config


def stages_of(config: ConfigDict, workdir: Path) -> list[Stage]:
    """Return the stages, and last the run that saves their mean and evaluates it.

    Raises UsageError for a mistake in `stages` or `average`.
    """
    if config.task not in STAGED:
        raise UsageError(f"config.stages: task {config.task!r} has no stages")
    found: list[Stage] = []
    for number, given in enumerate(config.stages):
        changes = dict(given)
        shares = _shares("start", changes.pop("start", ()), number)
        folder = workdir / f"stage_{number}"
        found.append(Stage(folder, _changed(config, changes, workdir), shares))
    total = sum(stage.config.train.steps for stage in found)
    last = found[-1].config.copy_and_resolve_references()
    last.train.update(steps=0, steps_before=total)
    found.append(Stage(workdir, last, _shares("average", config.average, len(found))))
    return found


def _changed(config, changes, workdir) -> ConfigDict:
    stage = config.copy_and_resolve_references()
    known = train.flat(config.to_dict())
    for key in train.flat(changes):
        if key not in known and not key.startswith(FREE):
            raise UsageError(f"config.stages: unknown config key {key!r}")
    with build.section("stages"), stage.unlocked():
        stage.update(changes)
    stage.stages = stage.average = ()
    drawn = "set" in config.data and not config.data.path
    if drawn and stage.data == config.data:
        if build.prepare_spec(stage) == build.prepare_spec(config):
            stage.data.path = str(_records(workdir))
    return stage


def _records(workdir: Path) -> Path:
    """Return where `build.prepared_data` makes a run's records."""
    return workdir / "data" / "records"


def _shares(name, given, count) -> tuple[float, ...]:
    """Return the shares of `count` stages; by default, all of the last one."""
    shares = tuple(given) or (0,) * (count - 1) + (1,) * (count > 0)
    if len(shares) != count or count and not np.isclose(sum(shares), 1):
        raise UsageError(
            f"config.{name} = {given}, expected {count} shares of 1 in all"
        )
    return shares


def _start(stage: Stage, stages: Sequence[Stage]) -> ConfigDict:
    """Return the config with the weights to start from, whose mean is written."""
    if not stage.shares:
        return stage.config
    config = stage.config.copy_and_resolve_references()
    used = {s.folder: w for s, w in zip(stages, stage.shares, strict=False) if w}
    path, *others = used
    if others:
        path = stage.folder / "start.safetensors"
        write_mean(path, used)
    config.train.initial = str(path)
    return config
