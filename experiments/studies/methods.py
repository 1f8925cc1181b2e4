r"""Every learned method on the same frames, with the same network and as many steps.

    python -m experiments.studies.methods --data RECORDS -o runs/methods \
        --steps 1500 --seed 0 --seed 1 --seed 2

Each method is trained from random weights by the recipe of `varied`: diffusion, direct
regression, and one pass, with the plain U-Net and with the network of kind `evidence`;
RPDNet, which has a network of its own, by that of `rpdnet`. All answer for the frames
of the test split, next to OS-CFAR at the rate that is best on validation frames, and
its points, smeared. `--method` and `--seed` choose what is trained; methods that an
earlier run has trained in the folder are in the tables, too.

`evaluation/table.md` has a row for each method and seed. Over the seeds, `kinds.md` has
mean F-scores in each kind of place, and `distances.md` by distance from the radar.
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

from experiments import enhance, rpdnet, train
from experiments.command import run_study, study_parser
from experiments.configs import rpdnet as rpdnet_config, varied
from jradar import data
from jradar.evaluation import (
    choose_rates,
    detector_methods,
    markdown_table,
    points_of,
    read_scores,
    records_in_view,
    score_and_keep,
    score_rings,
    write_report,
)
from jradar.evaluation.records import TRUTH
from jradar.files import write_text
from jradar.model import load_model

METHODS = ("rpdnet", "regression", "diffusion", "one pass", "evidence")
KEY = 21
EDGES_M = (0.0, 2.0, 4.0, 6.0, 8.0, 12.0)  # of distances from the radar


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
    view = records_in_view(records)
    rates = choose_rates(records_in_view(checked), checked, detectors=("os",))
    methods = detector_methods(view, rates)
    pairs = None
    for name, workdir in trained(options.output):
        if name.startswith("rpdnet"):
            detector = rpdnet.detector_of(workdir, checked)
            methods[name] = rpdnet.method_of(view, *detector)
            continue
        model = load_model(workdir / "model")
        pairs = data.pairs_of(model.spec, records)
        found = enhance.model_methods(varied.get_config(), model)
        found.pop("one-step estimate", None)
        rows = len(found) > 1
        methods |= {f"{name}: {k}" if rows else name: m for k, m in found.items()}
    if pairs is None:
        pairs = data.PairSource(records, view.fine, view.fine, num_slices=1)
    rings: list[dict[str, Any]] = []

    def watch(_frame, row, cloud, truth):
        if row["truth"] == TRUTH:
            found = score_rings(points_of(cloud), truth, edges=EDGES_M)
            rings.extend({"method": row["method"]} | ring for ring in found)

    key, every = jax.random.key(KEY), options.every
    found = score_and_keep(key, view, pairs, methods, every=every, watch=watch)
    write_report(options.output, *found, {})
    scores = read_scores(options.output / "evaluation" / "frames.jsonl")
    first = [row for row in scores if row["truth"] == TRUTH]
    for name, rows, part in (
        ("kinds", first, "scene"),
        ("distances", rings, "distance"),
    ):
        table = parts_table(rows, part)
        write_text(options.output / f"{name}.md", table)
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


def parts_table(rows: Iterable[dict[str, Any]], part: str) -> str:
    """Return Markdown: the mean F-score at 0.2 m (%) by part, over frames and seeds."""
    found: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in rows:
        name = re.sub(r", seed \d+", "", row["method"])
        found[row[part]][name].append(row["f_score_0.2"])
    names = [*dict.fromkeys(name for scores in found.values() for name in scores)]
    means = {
        key: [100 * np.nanmean(scores[name]) for name in names]
        for key, scores in sorted(found.items())
    }
    lines = [[key, *(f"{mean:.1f}" for mean in row)] for key, row in means.items()]
    overall = np.mean([*means.values()], 0)
    lines.append(["**mean**", *(f"**{mean:.1f}**" for mean in overall)])
    return markdown_table([part, *names], lines)


if __name__ == "__main__":
    sys.exit(main())
