"""The task `maps`: ColoRadar's radar maps in, the probability of LiDAR voxels out.

Training sees tiles of patches of some runs; other runs validate it, and fit the
confidence of the model that is saved. With `data.without`, an environment is left out
of both and validates instead.
"""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from ml_collections import ConfigDict

from experiments import build
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import data, diffusion, training
from jradar.errors import UsageError
from jradar.evaluation import Reliability, markdown_table, reliability
from jradar.files import write_text
from jradar.mapping import (
    PATCH_VOXELS,
    MapRun,
    Tiles,
    TileSpec,
    best_count,
    column_grid,
    enhance_map,
    enhance_patch,
    expected,
    nearest,
    open_runs,
    published_distance,
)
from jradar.metrics import f_score
from jradar.model import Card, ColumnGrid, Model, ModelSpec, load_model, save_model
from jradar.model.grids.columns import NOISE, outline
from jradar.range_image import fit_confidence
from jradar.viz import maps_figure, save_figure

SCORES = {  # of a patch
    "published": "F, published protocol",
    "published_8192": "with at most 8,192 voxels",
    "radar": "radar map, published protocol",
    "near": "F at 0.2 m",
    "expected": "F expected by the model",
}
TEST = "_run0"  # the published test runs, which training never sees
NEAR_M = 0.2
VALIDATED = 12  # every so many patches, while training


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    network(config)
    build.loss_of("columns", config.method)
    if not config.data.path:
        raise UsageError("no maps: pass the folder of runs as --config.data.path")
    initial_weights(config.train)


def network(config: ConfigDict) -> diffusion.Network:
    """Return the network, with an output for each height."""
    with build.section("network"):
        outputs = config.map.heights
        return diffusion.build_network(**config.network, outputs=outputs)


def splits(config: ConfigDict) -> dict[str, list[MapRun]]:
    """Return the runs of each split; `run0` of each environment is for testing.

    The runs of "confidence" validate, too, unless an environment is left out. Without
    any, all runs train.
    """
    found, left = open_runs(config.data.path), config.data.without
    runs = [run for run in found if not run.name.endswith(TEST)]
    environments = {run.environment for run in runs}
    if left and left not in environments:
        raise UsageError(
            f"data.without = {left!r}, expected one of {sorted(environments)}"
        )
    kept = set(config.data.validation)
    if missing := sorted(kept - {run.name for run in runs}):
        raise UsageError(
            f"data.validation names {missing[0]}, which is not in the data"
        )
    aside = [run for run in runs if run.environment == left]
    others = [run for run in runs if run.environment != left]
    confidence = [run for run in others if run.name in kept]
    if kept and not confidence:
        raise UsageError(
            f"data.validation = {config.data.validation}: no run to fit the confidence "
            f"on without {left}, expected one or more"
        )
    return {
        "train": [run for run in others if run.name not in kept],
        "confidence": confidence,
        "validation": aside or confidence,
        "test": [run for run in found if run.name.endswith(TEST)],
    }


def scored_runs(config: ConfigDict, runs: dict[str, list[MapRun]]) -> list[MapRun]:
    """Return the runs of the config's split. Raises UsageError without any."""
    if checked := runs.get(config.evaluation.split):
        return checked
    raise UsageError(
        f"evaluation.split = {config.evaluation.split!r}: no runs, expected one of "
        f"{[name for name, some in runs.items() if some]}"
    )


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on tiles."""
    runs = splits(config)
    train, checked = runs["train"], runs["validation"]
    scored_runs(config, runs)  # before hours of training
    with build.section("map"):
        grid = ColumnGrid(**config.map)
    with build.section("tiles"):
        tiles = Tiles(train, grid, TileSpec(**config.tiles))
    batches = data.Batches(
        tiles, seed=config.seed, batch_size=config.train.batch_size, change=tiles.draw
    )
    spec = ModelSpec(config.method, network(config), NOISE[config.method], grid)
    optimizer = build.build_optimizer(config.train)
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        spec.network,
        optimizer,
        image_shape=grid.image_shape,
        condition_shape=grid.condition_shape,
    )
    words = f"{len(tiles):,} patches of {len(train)} runs of ColoRadar"
    steps = config.train.steps_before + config.train.steps
    card = Card(purpose=config.purpose, steps_seen=steps, trained_on=words)

    def model_of(state: training.TrainState) -> Model:
        return Model(state.ema_params, spec, card=card)

    def validate(state: training.TrainState, step: int) -> dict[str, float]:
        rows = [*score_patches(model_of(state), checked, every=VALIDATED)]
        if not rows:
            return {}
        return {name: float(np.mean([row[name] for row in rows])) for name in SCORES}

    def save(state: training.TrainState) -> None:
        model = model_of(state)
        if held := runs["confidence"]:
            truth = voxel_truth(model, held, every=VALIDATED)
            model = model.with_tables(confidence=fit_confidence(*truth))
        save_model(workdir / "model", model, dtype=np.int8)

    return Training(
        state=start_from(config.train, spec.network, state),
        step=training.make_train_step(
            spec.network,
            optimizer,
            spec.noise,
            loss=build.loss_of("columns", config.method),
            ema_decay=config.train.ema_decay,
        ),
        batch_at=lambda step: training.Batch(*batches[step]),
        validate=validate,
        save=save,
        trained_on=words,
        data_digest=tiles.digest,
    )


def score_patches(
    model: Model, runs: Sequence[MapRun], *, every: int = 1
) -> Iterator[dict[str, Any]]:
    """Yield the scores of every so many patches of runs; see `SCORES`."""
    metres = column_grid(model).metres
    for run in runs:
        for k in range(0, len(run.radar_in_patch), every):
            radar, lidar = run.patch(k)
            robot = outline(radar)
            found = nearest(enhance_patch(radar, model), robot.x, robot.y, PATCH_VOXELS)
            count = best_count(found.probability, PATCH_VOXELS)
            points, truth = metres(found.voxels), metres(lidar)
            exact = published_distance(truth)
            chosen = found.probability[:count]
            right = is_among(found.voxels[:count], lidar)
            yield {
                "run": run.name,
                "environment": run.environment,
                "patch": k,
                "published": f_score(points[:count], truth, within_m=exact),
                "published_8192": f_score(points[:PATCH_VOXELS], truth, within_m=exact),
                "radar": f_score(metres(radar), truth, within_m=exact),
                "near": f_score(points[:count], truth, within_m=NEAR_M),
                "expected": float(2 * chosen.sum() / (count + PATCH_VOXELS)),
                "bins": _sums(chosen, right),
            }


def voxel_truth(
    model: Model, runs: Sequence[MapRun], *, every: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the probability of voxels of radar patches, and whether they are true."""
    parts = []
    for run in runs:
        for k in range(0, len(run.radar_in_patch), every):
            radar, _ = run.patch(k)
            found = enhance_patch(radar, model, least=0)
            x, y, radius = outline(radar)
            seen = np.hypot(*(found.voxels[:, :2] - (x, y)).T) <= radius
            right = is_among(found.voxels[seen], run.lidar)
            parts.append((found.probability[seen], right))
    probability, right = (np.concatenate(part) for part in zip(*parts, strict=True))
    return probability, right


def is_among(voxels: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return which voxels are among others."""
    places = 1 << np.array([42, 21, 0])  # of numbers up to a million, either way
    return np.isin(*((some.astype(np.int64) @ places) for some in (voxels, truth)))


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Score the model on the runs of the config's split."""
    model = load_model(config.model or workdir)
    checked = scored_runs(config, splits(config))
    for run in checked:
        figure = whole_map_figure(model, run)
        save_figure(figure, workdir / "evaluation" / f"{run.name}.png")
    rows = [*score_patches(model, checked, every=config.evaluation.every)]
    text = summary(rows)
    write_text(workdir / "evaluation" / "scores.json", json.dumps(rows) + "\n")
    write_text(workdir / "evaluation" / "table.md", text)
    print(f"{model}\n\n{text}")


def whole_map_figure(model: Model, run: MapRun) -> Figure:
    """Draw the whole maps of a run: the radar's, the model's and the LiDAR's.

    The model's map has as many voxels as the model expects.
    """
    found = expected(enhance_map(run.radar.astype(int), model))
    maps = {"radar": run.radar, "jradar": found.voxels, "LiDAR": run.lidar}
    return maps_figure({name: column_grid(model).metres(maps[name]) for name in maps})


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return the table of mean scores, by environment and of all patches.

    The calibration error is the mean distance of the probability of drawn voxels and
    the share of right ones, over bins of the probability.
    """
    groups: dict[str, list] = {}
    for row in rows:
        groups.setdefault(row["environment"], []).append(row)
    groups["all patches"] = [*rows]
    return markdown_table(
        ["environment", "patches", *SCORES.values(), "calibration error (%)"],
        [
            [name, str(len(group))]
            + [f"{np.mean([row[score] for row in group]):.3f}" for score in SCORES]
            + [f"{100 * _reliability(group).error():.1f}"]
            for name, group in groups.items()
        ],
    )


def _sums(probability, right):
    """The reliability of a patch's voxels, for JSON; zeros without voxels."""
    found = reliability(probability, right) if len(right) else np.zeros((3, 10))
    return np.stack(found).tolist()


def _reliability(rows):
    """That of the drawn voxels of patches."""
    return Reliability(*np.sum([row["bins"] for row in rows], 0))
