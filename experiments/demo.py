"""The task `demo`: score the CFAR detectors and the shipped models on unseen frames.

Frames are simulated. Nothing is trained, and the detectors have the config's
false-alarm rates. Data that the workdir already holds are used again.
"""

import itertools
import json
import sys
from pathlib import Path
from typing import Any

from ml_collections import ConfigDict

from experiments import build
from experiments.enhance import model_methods
from jradar import data
from jradar.evaluation import Method, RecordsInView, detector_methods, write_results
from jradar.files import write_text
from jradar.model import Model, ViewGrid, load_model, shipped_models
from jradar.progress import progress
from jradar.simulation import set_sequences, simulate_sequence

SPLIT = "test"
ABOUT = "**All frames are simulated**: the scores say nothing about a real radar."
FIRST = "jradar-sim"  # the model whose rows come first
EXPECTED = """
Expect F-scores at 0.2 m of about 55 % for `jradar-sim, one pass`, 44 % for what 8 draws
of the paper's method agree on, 38 % for `splat`, which is smeared radar points, 36 %
for the paper's single sample (Heun 18), and 23 % for OS-CFAR. The README's table has
higher ones: here, each layout has another radar unit, of a wider population and with
other waveforms.
"""


def check(config: ConfigDict) -> None:
    """Raise UsageError for a mistake in the config."""
    build.build_images(config.image)
    build.build_solver(config)


def setup(config: ConfigDict, workdir: Path) -> None:
    """Return None: nothing is trained."""


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Simulate, prepare, score and report."""
    folder = build.prepared_data(config, workdir, write=simulate_layouts)
    records = data.Records(folder, SPLIT)
    coarse, fine = build.build_images(config.image)
    view = RecordsInView(records, fine)
    rates = {
        name: config.evaluation.rates[name] for name in config.evaluation.detectors
    }
    shipped = {name: load_model(path) for name, path in shipped_models().items()}
    models = {k: m for k, m in shipped.items() if isinstance(m.spec.grid, ViewGrid)}
    usable = {
        name: model
        for name, model in models.items()
        if (model.spec.grid.coarse, model.spec.grid.fine) == (coarse, fine)
        and model.card.radar.cube_shape == records.radar.cube_shape
    }
    for name in models.keys() - usable.keys():
        print(f"{name} is for another radar or image: left out", file=sys.stderr)
    write_results(
        build.random_key(config, build.SAMPLE_KEY),
        workdir,
        view,
        data.PairSource(records, coarse, fine, num_slices=config.image.num_slices),
        detector_methods(view, rates) | shipped_methods(config, usable),
        about=ABOUT,
    )
    if usable:
        print(EXPECTED)
    else:
        print(
            "\nThis version ships no model for these images: the table holds the CFAR "
            "detectors alone."
        )


def shipped_methods(config: ConfigDict, models: dict[str, Model]) -> dict[str, Method]:
    """Return the methods of each model, by the name that `--model` takes."""
    return {
        f"{name}, {method.removeprefix('jradar, ')}": call
        for name in sorted(models, key=lambda name: (name != FIRST, name))
        for method, call in model_methods(config, models[name]).items()
    }


def simulate_layouts(config: ConfigDict, folder: Path) -> None:
    """Write the first `config.data.layouts` test layouts of each family of the set."""
    families: dict[str, list[Any]] = {}
    with build.section("data"):
        for item in set_sequences(config.data.set):
            if item.split == SPLIT:
                families.setdefault(item.family, []).append(item)
    layouts = [
        (item.family, item.seed, item.unit)
        for items in families.values()
        for item in items[: config.data.layouts]
    ]
    # A folder that exists is complete.
    missing = [
        each for each in layouts if not (folder / "{}_{}".format(*each)).is_dir()
    ]
    frames, done = config.data.frames, itertools.count(1)
    with progress("simulating", frames * len(missing), unit="frames") as show:
        for family, seed, unit in missing:
            options = {"frames": frames, "unit": unit}
            options["advance"] = lambda: show(next(done))
            simulate_sequence(family, seed, folder, **options)
    splits = {f"{family}_{seed}": SPLIT for family, seed, _ in layouts}
    write_text(folder / "splits.json", json.dumps(splits, indent=2) + "\n")
