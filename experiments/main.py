r"""Run an experiment.

    python -m experiments.main --config=experiments/configs/smoke.py \
        --workdir=runs/smoke

Fields of the config are overridden by `--config.train.steps=10`. The same command goes
on where an interrupted run stopped. `--mode=eval` scores the trained model again.

What JAX compiles is kept in ~/.cache/jradar (JRADAR_CACHE=off: not). Several processes
train together where JAX_COORDINATOR_ADDRESS names the first: see `training.devices`.
"""

import contextlib
import difflib
import importlib
import re
import runpy
import sys
from pathlib import Path

from absl import flags, logging
from ml_collections import config_flags

from jradar.files import lock_folder, use_compilation_cache

TASKS = ("enhance", "demo", "radarhd", "rpdnet", "pretrain")  # modules beside this one

CONFIG = config_flags.DEFINE_config_file("config", None, "File of the experiment.")
WORKDIR = flags.DEFINE_string("workdir", None, "Folder for everything it writes.")
MODE = flags.DEFINE_enum("mode", "train", ["train", "eval"], "What to do.")
flags.mark_flags_as_required(["config", "workdir"])


def main(argv: list[str]) -> int:
    """Parse flags, run, and return the exit code."""
    try:
        rest = flags.FLAGS(argv)
        if len(rest) > 1:
            raise flags.Error(f"unexpected argument {rest[1]!r}")
        config, workdir = CONFIG.value, Path(WORKDIR.value)
        config.lock()  # a missing file only shows when the config is first used
    except (flags.Error, AttributeError, KeyError, TypeError, ValueError, OSError) as e:
        if "--help" in argv:
            raise
        print(f"error: {_explain(argv, e)}", file=sys.stderr)
        return 2
    logging.set_verbosity(logging.WARNING)

    use_compilation_cache()
    try:
        return _run(config, workdir)
    except KeyboardInterrupt:  # before the first step or after the last
        return 130
    except (ValueError, FloatingPointError, OSError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return _exit_code(error)


def _run(config, workdir):
    """Do what the flags say. Processes of one run share a workdir, the first locks."""
    import jax

    from jradar.training import Interrupted, join_processes

    if config.task not in TASKS:
        raise ValueError(f"task = {config.task!r}, expected one of {TASKS}")
    join_processes()  # before a task's module may use a device
    task = importlib.import_module(f"experiments.tasks.{config.task}")
    run = {"train": task.run_training, "eval": task.run_evaluation}[MODE.value]
    first = jax.process_index() == 0
    try:
        with lock_folder(workdir) if first else contextlib.nullcontext():
            run(config, workdir)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return stop.exit_code
    return 0


def _exit_code(error):
    """Exit code of an error that a user can mend."""
    from jradar.bundle import BundleError
    from jradar.training import CheckpointError

    codes = {
        BundleError: 5,
        CheckpointError: 5,
        ValueError: 2,
        OSError: 3,
        ImportError: 3,
    }
    return next((c for kind, c in codes.items() if isinstance(error, kind)), 4)


def _explain(argv, error):
    """One line for a wrong flag; an unknown config key with the nearest valid one."""
    given = dict(re.findall(r"^--(config[^=]*)=(.*)$", "\n".join(argv), re.MULTILINE))
    path = given.pop("config", None)
    if path and not Path(path).is_file():
        return f"no such config file: {path}"
    known = [*_keys(runpy.run_path(path)["get_config"]())] if path else [*given]
    for key in given:
        name = key.removeprefix("config.")
        if name not in known:
            near = difflib.get_close_matches(name, known, 1) or [", ".join(known)]
            return f"unknown config key {name!r}, did you mean {near[0]}?"
    return " ".join(str(error).split())


def _keys(config, prefix=""):
    """Dotted keys of a config."""
    for key, value in config.items():
        yield f"{prefix}{key}"
        if hasattr(value, "items"):
            yield from _keys(value, f"{prefix}{key}.")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
