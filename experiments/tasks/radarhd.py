"""The task `radarhd`: polar radar images to LiDAR occupancy, on real pairs.

The diffusion half of the main model alone: its network, loss, sampler and loop with
another spec. What is drawn is an occupancy image of 0 and 1; a pixel is occupied where
it exceeds a threshold, which is chosen for each method on trajectories of their own.
"""

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import safetensors.numpy
from flax.traverse_util import flatten_dict, unflatten_dict
from ml_collections import ConfigDict

from experiments.build import (
    INIT_KEY,
    SAMPLE_KEY,
    TRAIN_KEY,
    build_optimizer,
    check_workdir,
)
from experiments.radarhd_pairs import LIDAR, RadarHD, open_radarhd, polar_to_points
from jradar import baselines, diffusion, evaluation, training, viz
from jradar.data.loading import Batches
from jradar.files import atomic_path, write_text
from jradar.metrics import THRESHOLDS_M, compare_on_host

LIMITS = 1 / (
    1 + np.exp(-np.arange(-5.0, 4.1, 0.25))
)  # of the drawn value, to choose from
CHOSEN_BY = "f_score_0.2"
SHOWN = 4  # frames in the picture
Draw = Callable[[jax.Array, jax.Array], jax.Array]


class Item(NamedTuple):
    """Images of one pair as the network takes them."""

    condition: np.ndarray  # [range, radar azimuth, history], 0 .. 1
    target: np.ndarray  # [range, azimuth, 1], 0 or 1


class Items(Sequence):
    """Pairs as items; with `mirror` the second half are the first ones turned over."""

    def __init__(self, pairs: RadarHD, *, history: int, mirror: bool = False):
        """`history` radar images make a condition."""
        self._pairs, self._history, self._mirror = pairs, history, mirror

    def __len__(self) -> int:
        return len(self._pairs) * (2 if self._mirror else 1)

    def __getitem__(self, index: Any) -> Any:
        """Item `index`."""
        turned, i = divmod(int(index), len(self._pairs))
        condition = self._pairs.history(i, self._history).astype(np.float32) / 255
        target = self._pairs[i].lidar.astype(np.float32)[..., None]
        if turned:
            condition, target = condition[:, ::-1], target[:, ::-1]
        return Item(condition, target)


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the weights, evaluate. Resumes where the workdir stands."""
    check_workdir(config, workdir)
    pairs = open_radarhd(config.data.path)
    kept_apart = (*config.data.threshold_trajectories, *config.data.report_trajectories)
    train = pairs.without(kept_apart)
    print(f"{len(train)} training pairs", file=sys.stderr, flush=True)
    items = Items(train, history=config.data.history, mirror=config.train.mirror)
    batches = Batches(items, seed=config.seed, batch_size=config.train.batch_size)
    network, noise = build_network(config)
    optimizer = build_optimizer(config.train)
    first = items[0]
    state = training.create_state(
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        network,
        optimizer,
        image_shape=first.target.shape,
        condition_shape=first.condition.shape,
    )
    checked = open_radarhd(config.data.path).of(config.data.threshold_trajectories)

    def evaluate(state, step):
        draws = make_draws(config, state.ema_params, one_step_only=True)
        rows = [*score(config, checked, draws, every=8)]
        limits = choose_limits(rows)
        return mean_scores([r for r in rows if r["limit"] == limits[r["method"]]])

    loss = {
        "diffusion": diffusion.occupancy_denoising_loss,
        "regression": baselines.occupancy_loss,
    }[config.method]
    state = training.train(
        jax.random.fold_in(jax.random.key(config.seed), TRAIN_KEY),
        state,
        training.make_train_step(
            network, optimizer, noise, loss=loss, ema_decay=config.train.ema_decay
        ),
        lambda step: training.Batch(*batches[step]),
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
        evaluate_every=config.train.evaluate_every,
        evaluate=evaluate,
        best="chamfer",
    )
    save_weights(workdir / "weights.safetensors", state.ema_params)
    run_evaluation(config, workdir)


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Score the weights; limits, table, per-frame scores and a picture."""
    params = load_weights(Path(config.weights or workdir / "weights.safetensors"))
    draws = make_draws(config, params)
    pairs = open_radarhd(config.data.path)
    chosen = pairs.of(config.data.threshold_trajectories)
    limits = choose_limits(score(config, chosen, draws, every=config.data.every))
    if Path(config.data.path).is_dir() and (Path(config.data.path) / "test").is_dir():
        reported, where = (
            open_radarhd(config.data.path, split="test"),
            "test trajectories",
        )
    else:
        reported = pairs.of(config.data.report_trajectories)
        where = f"trajectories {config.data.report_trajectories}, never trained on"
    every = config.data.every
    rows = [*score(config, reported, draws, every=every, limits=limits)]
    folder = workdir / "evaluation"
    write_text(folder / "frames.jsonl", "".join(json.dumps(r) + "\n" for r in rows))
    table = f"{config.purpose}; {where}\n\n{markdown(rows, limits)}"
    write_text(folder / "table.md", table)
    figure = picture(config, reported, draws, limits)
    viz.save_figure(figure, folder / "samples.png")
    print(f"{table}\nwritten to {folder}")


def build_network(config: ConfigDict) -> tuple[diffusion.UNet, diffusion.NoiseSpec]:
    """The network and its noise levels."""
    return diffusion.UNet(**config.network), diffusion.NoiseSpec(**config.noise)


def make_draws(
    config: ConfigDict, params: Any, *, one_step_only: bool = False
) -> dict[str, Draw]:
    """Functions (key, conditions) -> images [batch, range, azimuth], by method."""
    network, noise = build_network(config)

    def drawn(draw):
        def images(key, condition):
            denoise = diffusion.conditional_denoiser(network, params, noise)(condition)
            shape = (len(condition), *LIDAR.shape, 1)
            return draw(key, denoise, shape)[..., 0]

        return jax.jit(images)

    def sample(steps):
        return lambda key, denoise, shape: diffusion.sample(
            key, denoise, shape, noise=noise, steps=steps
        )

    if config.method == "regression":
        return {
            "direct regression": drawn(
                lambda _, denoise, shape: baselines.regression_estimate(
                    denoise, shape, noise=noise
                )
            )
        }
    draws = {"one-step estimate": drawn(sample(1))}
    if not one_step_only:
        steps = config.sampling.steps
        draws[f"diffusion, Heun {steps}"] = drawn(sample(steps))
    return draws


def score(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    *,
    every: int = 1,
    limits: dict[str, float] | None = None,
) -> Iterator[dict[str, Any]]:
    """Scores of each method on every so many frames, at its limit or at all of LIMITS.

    `chamfer` is the mean of the two mean distances and `modified_hausdorff` the larger
    of the two medians, as RadarHD has them, in metres.
    """
    items = Items(pairs, history=config.data.history)
    index = np.arange(0, len(pairs), every)
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    size = config.sampling.batch_size
    for first in range(0, len(index), size):
        part = index[first : first + size]
        padded = np.resize(part, size)  # one shape, compiled once
        condition = jnp.asarray(np.stack([items[i].condition for i in padded]))
        for name, draw in draws.items():
            images = np.asarray(draw(jax.random.fold_in(key, first), condition))
            for image, i in zip(images, part, strict=False):
                pair = pairs[int(i)]
                truth = polar_to_points(pair.lidar)
                for limit in LIMITS if limits is None else [limits[name]]:
                    found = polar_to_points(image > limit)
                    yield {
                        "method": name,
                        "trajectory": pair.trajectory,
                        "frame": pair.frame,
                        "limit": float(limit),
                        "points": len(found),
                        **plane_scores(found, truth),
                    }


def plane_scores(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Scores of one frame; no distance and F of 0 where nothing was found."""
    if not len(found) or not len(truth):
        nothing = {f"f_score_{limit}": 0.0 for limit in THRESHOLDS_M}
        return {"chamfer": np.nan, "modified_hausdorff": np.nan, **nothing}
    scores = compare_on_host(found, truth)
    f_scores = {
        f"f_score_{limit}": float(value)
        for limit, value in zip(THRESHOLDS_M, scores.f_score, strict=True)
    }
    return {
        "chamfer": float(scores.chamfer) / 2,
        "modified_hausdorff": float(scores.modified_hausdorff),
        **f_scores,
    }


def choose_limits(rows: Any) -> dict[str, float]:
    """The limit of each method with the best mean F-score at 0.2 m."""
    sums: dict[tuple[str, float], list[float]] = {}
    for row in rows:
        sums.setdefault((row["method"], row["limit"]), []).append(row[CHOSEN_BY])
    best: dict[str, float] = {}
    for (method, limit), values in sums.items():
        current = best.get(method)
        if current is None or np.mean(values) > np.mean(sums[method, current]):
            best[method] = limit
    return best


def mean_scores(rows: list[dict[str, Any]]) -> dict[str, float]:
    """Means of the scores; a frame without any point counts as one of 10.8 m."""
    names = [name for name in rows[0] if name.startswith(("f_", "chamfer", "modified"))]
    values = {name: np.array([row[name] for row in rows]) for name in names}
    return {
        name: float(np.nan_to_num(value, nan=LIDAR.max_range_m).mean())
        for name, value in values.items()
    }


def markdown(rows: list[dict[str, Any]], limits: dict[str, float]) -> str:
    """Means with 95 % intervals that know of the correlation of neighbouring frames."""
    columns = {
        "chamfer": ("Chamfer (m)", 1.0),
        "modified_hausdorff": ("MHD (m)", 1.0),
        **{f"f_score_{t}": (f"F {t} m (%)", 100.0) for t in THRESHOLDS_M},
    }
    lines = [
        "| method | limit | "
        + " | ".join(title for title, _ in columns.values())
        + " | frames |",
        "|---" * (len(columns) + 3) + "|",
    ]
    for method, limit in limits.items():
        mine = [row for row in rows if row["method"] == method]
        trajectories = sorted({row["trajectory"] for row in mine})
        cells = []
        for name, (_, scale) in columns.items():
            series = [
                [row[name] for row in mine if row["trajectory"] == t]
                for t in trajectories
            ]
            estimate = evaluation.mean_interval(series)
            digits = 3 if scale == 1 else 1
            cells.append(
                f"{scale * estimate.mean:.{digits}f} "
                f"({scale * estimate.low:.{digits}f} to "
                f"{scale * estimate.high:.{digits}f})"
            )
        cells.append(str(len(mine)))
        lines.append(f"| {method} | {limit:.2f} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def picture(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: dict[str, float],
) -> Any:
    """Radar, truth and what each method draws, from above, for a few frames."""
    items = Items(pairs, history=config.data.history)
    index = np.linspace(0, len(pairs) - 1, SHOWN).astype(int)
    condition = jnp.asarray(np.stack([items[i].condition for i in index]))
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    columns = {"LiDAR": [polar_to_points(pairs[int(i)].lidar) for i in index]}
    for name, draw in draws.items():
        images = np.asarray(draw(key, condition))
        columns[name] = [polar_to_points(image > limits[name]) for image in images]
    return viz.plane_figure(
        np.asarray(condition[..., 0]), columns, max_range_m=LIDAR.max_range_m
    )


def save_weights(path: Path, params: Any) -> None:
    """Parameters as safetensors of float16: half the size, and exact enough."""
    flat = flatten_dict(params, sep="/")
    content = safetensors.numpy.save(
        {name: np.asarray(value, np.float16) for name, value in flat.items()}
    )
    with atomic_path(path) as scratch:
        scratch.write_bytes(content)


def load_weights(path: Path) -> Any:
    """The parameters of `save_weights`, in float32."""
    if not path.is_file():
        raise FileNotFoundError(f"no weights at {path}: train first, without --mode")
    try:
        flat = safetensors.numpy.load(path.read_bytes())
    except safetensors.SafetensorError as error:
        raise ValueError(f"{path} is not usable: {error}") from error
    params = {name: jnp.asarray(value, jnp.float32) for name, value in flat.items()}
    return unflatten_dict(params, sep="/")
