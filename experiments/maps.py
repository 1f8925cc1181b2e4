"""The task `maps`: radar maps of ColoRadar to LiDAR maps."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.train import Training
from experiments.weights import load_weights, start_from
from jradar import data, diffusion, training
from jradar.errors import UsageError
from jradar.mapping import columns, losses, patches, predict, scores, tiles

POINTS = 8192  # of a LiDAR patch


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    networks(config)
    if not config.data.path:
        raise UsageError("no maps: pass the folder of runs as --config.data.path")


def networks(config: ConfigDict):
    """Return the network and its noise levels."""
    with build.section("network"):
        network = diffusion.build_network(**config.network)
    mixture = diffusion.PREDICTIONS["mixture"]
    return network, diffusion.NoiseSpec(sigma_data=1.0, prediction=mixture)


def splits(config: ConfigDict):
    """Return the runs of training and of validation."""
    runs = patches.open_runs(config.data.path)
    kept = set(config.data.validation)
    left = config.data.without
    if missing := kept - {run.name for run in runs}:
        raise UsageError(f"data.validation: no run {sorted(missing)[0]}")
    train = [r for r in runs if r.name not in kept and r.environment != left]
    checked = [r for r in runs if r.name in kept]
    return train, checked


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the training of the network on tiles of the other runs."""
    train, checked = splits(config)
    spec = columns.MapSpec(**config.map)
    items = tiles.Tiles(train, spec, tiles.TileSpec(**config.tiles))
    batches = data.Batches(
        items, seed=config.seed, batch_size=config.train.batch_size, change=items.draw
    )
    network, noise = networks(config)
    optimizer = build.build_optimizer(config.train)
    first = items.draw(items[0], np.random.default_rng(0))
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        network,
        optimizer,
        image_shape=first.target.shape,
        condition_shape=first.condition.shape,
    )

    def validate(state, step):
        rows = [*score_patches(config, state.ema_params, checked, every=20)]
        return {name: float(np.mean([r[name] for r in rows])) for name in SCORES}

    return Training(
        state=start_from(config.train, network, state),
        step=training.make_train_step(
            network,
            optimizer,
            noise,
            loss=losses.occupancy_loss,
            ema_decay=config.train.ema_decay,
        ),
        batch_at=lambda step: training.Batch(*batches[step]),
        validate=validate,
        save=lambda state: diffusion.write_params(
            workdir / "weights.safetensors", state.ema_params
        ),
        trained_on=f"{len(items)} patches of {len(train)} runs",
        data_digest="",
    )


SCORES = ("published", "published_8192", "f_score_0.2")


def score_patches(config: ConfigDict, params: Any, runs: Any, *, every: int = 1):
    """Yield the scores of every so many patches of runs."""
    spec = columns.MapSpec(**config.map)
    network, noise = networks(config)
    model = {"params": params, "network": network, "noise": noise}
    for run in runs:
        for k in range(0, len(run.radar_in_patch), every):
            radar = run.radar[run.radar_in_patch[k]].astype(int)
            truth = (run.lidar[run.lidar_in_patch[k]] + 0.5) * spec.voxel_m
            found = predict.enhance_patch(radar, spec, **model)
            count = predict.best_count(found.probability, POINTS)
            points = (found.voxels + 0.5) * spec.voxel_m
            near = scores.published_distance(truth)
            yield {
                "run": run.name,
                "patch": k,
                "count": count,
                "expected": float(
                    2 * found.probability[:count].sum() / (count + POINTS)
                ),
                "published": scores.f_score(points[:count], truth, near),
                "published_8192": scores.f_score(points[:POINTS], truth, near),
                "f_score_0.2": scores.f_score(points[:count], truth, 0.2),
            }


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Score the weights on the validation runs."""
    params = load_weights(workdir / "weights.safetensors")
    _, checked = splits(config)
    rows = [*score_patches(config, params, checked, every=config.evaluation.every)]
    (workdir / "scores.json").write_text(json.dumps(rows))
    for name in SCORES:
        print(name, np.mean([row[name] for row in rows]))
