r"""Run an experiment.

    python -m experiments.main --config=experiments/configs/smoke.py \
        --workdir=runs/smoke

`--config.train.steps=10` overrides a field of the config. The same command resumes an
interrupted run. `--mode=eval` evaluates the trained model again. `--seeds=0:3` repeats
the run in WORKDIR/seed_0 to seed_2, and prints the mean and the spread of the scores.

Compiled programs are cached in ~/.cache/jradar; JRADAR_CACHE=off disables the cache.
Several processes train together if JAX_COORDINATOR_ADDRESS names the first one: see
`jradar.training.parallel`.
"""

import contextlib
import difflib
import importlib
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path

from absl import flags, logging
from ml_collections import ConfigDict, config_flags

from experiments.command import exit_code_of
from jradar.errors import UsageError, check_platform
from jradar.files import lock_folder, use_compilation_cache

TASKS = ("enhance", "demo", "maps", "radarhd", "rpdnet")  # modules of this package


def main(argv: list[str]) -> int:
    """Parse flags, run, and return the exit code."""
    if "--help" in argv:
        print(__doc__)
        return 0
    return exit_code_of(lambda: _run_seeds(*_parse(argv)))


def _flags(argv):
    values = flags.FlagValues()
    config_flags.DEFINE_config_file(
        "config", None, "file of the experiment", flag_values=values, sys_argv=argv
    )
    flags.DEFINE_string("workdir", None, "folder for all results", flag_values=values)
    flags.DEFINE_enum(
        "mode", "train", ["train", "eval"], "what to do", flag_values=values
    )
    flags.DEFINE_string("seeds", "", "seeds A to B-1, A:B", flag_values=values)
    flags.mark_flags_as_required(["config", "workdir"], flag_values=values)
    return values


def _parse(argv: list[str]) -> tuple[ConfigDict, Path, str, range | None]:
    """The config, workdir, mode and seeds. Raises UsageError for a wrong flag."""
    values = _flags(argv)
    try:
        rest = values(argv)
        if len(rest) > 1:
            raise UsageError(f"unexpected argument {rest[1]!r}")
        config = values.config
        config.lock()  # an unreadable file only shows when the config is first used
    except (flags.Error, AttributeError, KeyError, TypeError, ValueError, OSError) as e:
        raise UsageError(_explain(argv, e)) from e
    if config.task not in TASKS:
        raise UsageError(f"task = {config.task!r}, expected one of {TASKS}")
    seeds = None
    if values.seeds:
        ends = re.fullmatch(r"(\d{1,9}):(\d{1,9})", values.seeds)
        seeds = range(*map(int, ends.groups())) if ends else range(0)
        if len(seeds) < 2:
            raise UsageError(f"--seeds={values.seeds}, expected two or more, as 0:3")
    return config, Path(values.workdir), values.mode, seeds


def _run_seeds(
    config: ConfigDict, workdir: Path, mode: str, seeds: range | None
) -> int:
    """Run once, or once for each seed; later seeds use the data of the first."""
    if seeds is None:
        return _run(config, workdir, mode)
    runs = [workdir / f"seed_{seed}" for seed in seeds]
    for seed, run in zip(seeds, runs, strict=True):
        config.seed = seed
        if code := _run(config, run, mode):
            return code
        if (records := runs[0] / "data" / "records").is_dir() and not config.data.path:
            config.data.path = str(records)
    from jradar.evaluation.tables import seeds_table

    print(f"\n{seeds_table(runs)}")
    return 0


def _run(config: ConfigDict, workdir: Path, mode: str) -> int:
    """Train or evaluate. The first process of a run locks the shared workdir."""
    logging.set_verbosity(logging.WARNING)
    use_compilation_cache()
    import jax

    from jradar.training.loop import Interrupted
    from jradar.training.parallel import join_processes

    join_processes()  # before a task's module may use a device
    check_platform()
    from experiments import stages

    task = importlib.import_module(f"experiments.{config.task}")
    try:
        with contextlib.nullcontext() if jax.process_index() else lock_folder(workdir):
            if mode == "train":
                stages.run(task, config, workdir)
            elif not jax.process_index():
                task.evaluate(stages.final_config(config, workdir), workdir)
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return stop.exit_code
    return 0


def _explain(argv: list[str], error: BaseException) -> str:
    """One line for a wrong flag; for an unknown config key, the nearest valid one."""
    given = dict(re.findall(r"^--(config[^=]*)=(.*)$", "\n".join(argv), re.MULTILINE))
    path = given.pop("config", None)
    if path and not Path(path).is_file():
        return f"no such config file: {path}"
    known = [*config_keys(runpy.run_path(path)["get_config"]())] if path else [*given]
    for key in given:
        name = key.removeprefix("config.")
        if name not in known:
            near = difflib.get_close_matches(name, known, 1) or [", ".join(known)]
            return f"unknown config key {name!r}, did you mean {near[0]}?"
    return " ".join(str(error).split())


def config_keys(config: ConfigDict, prefix: str = "") -> Iterator[str]:
    """Dotted keys of a config."""
    for key, value in config.items():
        yield f"{prefix}{key}"
        if hasattr(value, "items"):
            yield from config_keys(value, f"{prefix}{key}.")


if __name__ == "__main__":
    sys.exit(main(sys.argv))
