"""The task `demo`: simulate unseen frames, and compare what needs no training.

These are the CFAR detectors, at the config's false-alarm rates, and the bundles that
the package ships. Data that the workdir holds are used again.
"""

import contextlib
import itertools
import json
import sys
from pathlib import Path

import jax
from ml_collections import ConfigDict

from experiments import build
from experiments.evaluate import write_results
from experiments.studies.detectors import Method, View, detector_methods
from experiments.tasks.enhance import build_methods
from jradar import data
from jradar.bundle import DEFAULT, Bundle, load_bundle, shipped_bundles
from jradar.files import write_text
from jradar.progress import progress
from jradar.range_image import ImageSpec
from jradar.simulation import set_sequences, simulate_sequence

SPLIT = "test"
REGRESSION = "-regression"


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Simulate, prepare, score, and report; the tables go to stdout."""
    build.check_workdir(config, workdir)
    records = data.Records(simulated_data(config, workdir), SPLIT)
    sees = build.view(config.image)
    coarse = ImageSpec(*config.image.coarse, **sees)
    view = View(records.radar, ImageSpec(*config.image.fine, **sees))
    slices = config.image.num_slices
    rates = {
        name: config.evaluation.rates[name] for name in config.evaluation.detectors
    }
    bundles = {name: load_bundle(path) for name, path in shipped_bundles().items()}
    usable = {
        name: bundle
        for name, bundle in bundles.items()
        if (bundle.spec.coarse, bundle.spec.fine, bundle.spec.num_slices)
        == (coarse, view.fine, slices)
        and bundle.spec.radar.cube_shape == records.radar.cube_shape
    }
    for name in bundles.keys() - usable.keys():
        print(f"{name} is for another radar or image: left out", file=sys.stderr)
    write_results(
        jax.random.fold_in(jax.random.key(config.seed), build.SAMPLE_KEY),
        workdir,
        view,
        records,
        data.PairSource(records, coarse, view.fine, num_slices=slices),
        detector_methods(view, rates) | learned(config, usable),
    )
    if not usable:
        print(
            "\nNo trained weights come with this version: the table holds the CFAR "
            "detectors alone."
        )


run_training = run_evaluation  # nothing is trained


def learned(config: ConfigDict, bundles: dict[str, Bundle]) -> dict[str, Method]:
    """Methods of each bundle, the default's first; a name that is taken gets its own.

    A bundle called `..-regression` was trained by direct regression.
    """
    methods: dict[str, Method] = {}
    for name in sorted(bundles, key=lambda name: (name != DEFAULT, name)):
        options = ConfigDict(config.to_dict())
        options.method = "regression" if name.endswith(REGRESSION) else "diffusion"
        for method, call in build_methods(options, bundles[name]).items():
            methods[f"{name}: {method}" if method in methods else method] = call
    return methods


def simulated_data(config: ConfigDict, workdir: Path) -> Path:
    """The folder of records, simulated and prepared if need be."""
    recordings, records = workdir / "data" / "recordings", workdir / "data" / "records"
    with contextlib.suppress(FileNotFoundError, ValueError):  # not there or not whole
        return data.Records(records).folder
    of_family: dict[str, list[int]] = {}
    for split, family, seed in set_sequences(config.data.set):
        if split == SPLIT:
            of_family.setdefault(family, []).append(seed)
    layouts = [
        (family, seed)
        for family, seeds in of_family.items()
        for seed in seeds[: config.data.layouts]
    ]
    frames, done = config.data.frames, itertools.count(1)
    splits = {f"{family}_{seed}": SPLIT for family, seed in layouts}
    with progress("simulating", frames * len(layouts), unit="frames") as show:
        for family, seed in layouts:
            folder = recordings / f"{family}_{seed}"
            if folder.is_dir():  # a folder is there when it is complete
                for _ in range(frames):
                    show(next(done), family)
                continue
            simulate_sequence(
                family,
                seed,
                recordings,
                frames=frames,
                advance=lambda family=family: show(next(done), family),
            )
    write_text(recordings / "splits.json", json.dumps(splits, indent=2) + "\n")
    build.prepare(config, recordings, records)
    return records
