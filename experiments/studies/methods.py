r"""Every learned method on the same frames, with the same network and as many steps.

    python -m experiments.studies.methods --data RECORDS -o runs/methods \
        --steps 1500 --seed 0 --seed 1 --seed 2

Each method is trained from random weights by the recipe of `varied`: diffusion, direct
regression, and one pass, with the plain U-Net and with the network of kind `evidence`;
RPDNet, which has a network of its own, by that of `rpdnet`. All answer for the frames
of the test split, next to OS-CFAR at the rate that is best on validation frames, and
its points, smeared. `--method` and `--seed` choose what is trained; methods that an
earlier run has trained in the folder are in the tables, too.

`evaluation/table.md` has a row for each method and seed, `kinds.md` mean F-scores in
each kind of place, over the seeds.
"""

import re
import sys
from argparse import Namespace
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict, config_dict

from experiments import build, enhance, rpdnet, train
from experiments.command import run_study, study_parser
from experiments.configs import rpdnet as rpdnet_config, varied
from jradar import data
from jradar.evaluation import (
    choose_rates,
    detector_methods,
    markdown_table,
    read_scores,
    view_of,
    write_results,
)
from jradar.evaluation.records import TRUTH
from jradar.files import write_text
from jradar.model import load_model

METHODS = ("rpdnet", "regression", "diffusion", "one pass", "evidence")
KEY = 21


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.methods", __doc__)
    parser.add_argument("--data", type=Path, required=True, help="prepared records")
    parser.add_argument("--steps", type=int, default=1500, help="of each method")
    parser.add_argument("--method", action="append", choices=METHODS)
    parser.add_argument("--seed", type=int, action="append")
    parser.add_argument("--every", type=int, default=1, help="score every N-th frame")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Train what is missing, score all methods, and write the tables."""
    for method in options.method or METHODS:
        for seed in options.seed or [0]:
            workdir = options.output / method.replace(" ", "_") / f"seed_{seed}"
            config = config_of(method, seed, options.data, options.steps)
            task = rpdnet if method == "rpdnet" else enhance
            train.check_workdir(config, workdir)
            if not finished(workdir):
                train.run(task, config, workdir)
    checked = data.Records(options.data, "validation")
    records = data.Records(options.data, "test")
    view = view_of(records)
    rates = choose_rates(view_of(checked), checked, detectors=("os",))
    methods = detector_methods(view, rates)
    pairs = None
    for name, workdir in trained(options.output):
        if name.startswith("rpdnet"):
            detector = rpdnet.detector_of(workdir, checked)
            methods[name] = rpdnet.method_of(view, *detector)
            continue
        model = load_model(workdir / "model")
        pairs = build.build_pairs(model.spec, records)
        found = enhance.model_methods(varied.get_config(), model)
        found.pop("one-step estimate", None)
        rows = len(found) > 1
        methods |= {f"{name}: {k}" if rows else name: m for k, m in found.items()}
    if pairs is None:
        pairs = data.PairSource(records, view.fine, view.fine, num_slices=1)
    key = jax.random.key(KEY)
    write_results(key, options.output, view, pairs, methods, every=options.every)
    scores = read_scores(options.output / "evaluation" / "frames.jsonl")
    table = kinds_table(scores)
    write_text(options.output / "kinds.md", table)
    print(table)


def config_of(method: str, seed: int, records: Path, steps: int) -> ConfigDict:
    """Return the config that trains a method; the tables are the study's."""
    config = (rpdnet_config if method == "rpdnet" else varied).get_config()
    config.seed, config.data.path = seed, str(records)
    config.train.initial = config_dict.placeholder(str)
    config.train.update(steps=steps, learning_rate=1e-3, warmup_steps=100)
    config.train.update(checkpoint_every=100, evaluate_every=max(steps // 3, 1))
    config.evaluation.update(split="validation", every=100)
    if method == "regression":
        config.method, config.noise.prediction = "regression", "clean"
    if method in ("one pass", "evidence"):
        config.method, config.noise.prediction = "marginal", "mixture"
    if method == "evidence":
        config.network.kind = "evidence"
    return config


def finished(workdir: Path) -> bool:
    """True if a run has saved its model, and scored it."""
    return (workdir / "evaluation" / "table.md").exists()


def trained(folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the finished runs of a folder, named as in the tables."""
    for method in METHODS:
        for workdir in sorted(folder.glob(f"{method.replace(' ', '_')}/seed_*")):
            if finished(workdir):
                yield f"{method}, seed {workdir.name.removeprefix('seed_')}", workdir


def kinds_table(scores: Iterable[dict[str, Any]]) -> str:
    """Return Markdown: the mean F-score at 0.2 m (%) by kind, over frames and seeds."""
    found: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in scores:
        if row["truth"] == TRUTH:
            name = re.sub(r", seed \d+", "", row["method"])
            found[row["scene"]][name].append(row["f_score_0.2"])
    names = [*dict.fromkeys(name for means in found.values() for name in means)]
    rows = [
        [kind, *(f"{100 * np.nanmean(means[name]):.1f}" for name in names)]
        for kind, means in sorted(found.items())
    ]
    means = np.mean([[float(value) for value in row[1:]] for row in rows], 0)
    rows.append(["**mean of kinds**", *(f"**{value:.1f}**" for value in means)])
    return markdown_table(["kind", *names], rows)


if __name__ == "__main__":
    sys.exit(main())
