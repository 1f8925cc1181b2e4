"""The task `radarhd`: polar radar images to LiDAR occupancy, on real pairs.

The diffusion half of the main model alone: its network, sampler and loop, with another
prediction and loss. Samples are occupancy images of 0 and 1. A pixel is occupied where
it exceeds a limit, which is chosen for each method on trajectories kept for that.
"""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key
from ml_collections import ConfigDict

from experiments import build
from experiments.tasks.radarhd_augment import AUGMENTATIONS, augment
from experiments.tasks.radarhd_confidence import fit_confidence
from experiments.tasks.radarhd_nearness import mirrored, nearness_loss
from experiments.tasks.radarhd_occupancy import (
    OCCUPANCY,
    agreed_occupancy,
    occupancy_denoising_loss,
    occupancy_regression_loss,
)
from experiments.tasks.radarhd_pairs import (
    LIDAR,
    RADAR,
    PolarItems,
    RadarHD,
    open_radarhd,
)
from experiments.tasks.radarhd_report import write_results
from experiments.tasks.radarhd_scores import (
    PROTOCOLS,
    Draw,
    at_limits,
    choose_limits,
    mean_scores,
    score_pairs,
)
from experiments.train import Training
from experiments.weights import initial_weights, load_weights, start_from
from jradar import data, diffusion, training
from jradar.errors import ModelError, UsageError

LOSSES = {
    "diffusion": occupancy_denoising_loss,
    "nearness": nearness_loss,
    "regression": occupancy_regression_loss,
}
QUICK_STEPS = 8  # of each draw of those that have to agree


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    networks(config)
    if config.method not in LOSSES:
        raise UsageError(f"method = {config.method!r}, expected one of {[*LOSSES]}")
    if not config.data.path:
        raise UsageError("no pairs: pass RadarHD's folder as --config.data.path")
    initial_weights(config.train)
    if unknown := set(config.train.augment) - set(AUGMENTATIONS):
        raise UsageError(
            f"train.augment = {config.train.augment}, without {sorted(unknown)[0]!r}: "
            f"expected names of {[*AUGMENTATIONS]}"
        )
    if not 0 <= config.data.simulated_share <= 1:
        raise UsageError(
            f"data.simulated_share = {config.data.simulated_share}, expected 0 to 1"
        )
    if config.data.simulated_share and not config.data.simulated:
        raise UsageError("no simulated pairs: pass them as --config.data.simulated")


def networks(config: ConfigDict) -> tuple[diffusion.Network, diffusion.NoiseSpec]:
    """Return the network and its noise levels."""
    noise = build.build_noise(config, predictions={OCCUPANCY.name: OCCUPANCY})
    with build.section("network"):
        return diffusion.build_network(**config.network), noise


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on the pairs of the other trajectories."""
    pairs = open_radarhd(config.data.path)
    kept = (*config.data.threshold_trajectories, *config.data.report_trajectories)
    train, checked = pairs.without(kept), threshold_pairs(config, pairs)
    batches, trained_on = training_batches(config, train)
    network, noise = networks(config)
    optimizer = build.build_optimizer(config.train)
    first = PolarItems(train, history=config.data.history)[0]
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        network,
        optimizer,
        image_shape=first.target.shape,
        condition_shape=first.condition.shape,
    )
    state = start_from(config.train, network, state)

    def validate(state, step):
        method = quickest(draw_methods(config, state.ema_params))
        rows = [*score_pairs(config, checked, method, every=8)]
        return mean_scores(at_limits(rows, choose_limits(rows)))

    return Training(
        state=state,
        step=training.make_train_step(
            network,
            optimizer,
            noise,
            loss=LOSSES[config.method],
            ema_decay=config.train.ema_decay,
        ),
        batch_at=batches,
        validate=validate,
        save=lambda state: diffusion.write_params(
            workdir / "weights.safetensors", state.ema_params
        ),
        trained_on=trained_on,
        data_digest=train.digest,
    )


def training_batches(
    config: ConfigDict, train: RadarHD
) -> tuple[Callable[[int], training.Batch], str]:
    """Return the function from a step to its batch, and what it holds in words.

    The share `data.simulated_share` of each batch are pairs of `data.simulated`.
    """
    size = config.train.batch_size
    simulated = round(size * config.data.simulated_share)
    sources, words = [(train, size - simulated)], f"{len(train)} pairs"
    if simulated:
        sources += [(open_radarhd(config.data.simulated), simulated)]
        words += f", and {len(sources[1][0])} simulated ones, {simulated} of {size}"
    batches = []
    for pairs, number in sources:
        if number:
            items = PolarItems(
                pairs, history=config.data.history, mirror=config.train.mirror
            )
            change = functools.partial(
                augment, names=config.train.augment, others=items
            )
            batches += [
                data.Batches(items, seed=config.seed, batch_size=number, change=change)
            ]

    def batch_at(step):
        parts = [part[step] for part in batches]
        return training.Batch(*map(np.concatenate, zip(*parts, strict=True)))

    return batch_at, words


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Choose limits, and score the weights on the test pairs: table and picture."""
    for weights in (config.weights, config.nearness.weights):
        if weights and not Path(weights).is_file():
            raise UsageError(f"weights = {weights}: no such file")
    path = Path(config.weights or workdir / "weights.safetensors")
    params = fitting_weights(path, networks(config)[0], config.data.history)
    draws = draw_methods(config, params)
    pairs, every = open_radarhd(config.data.path), config.data.every
    checked = threshold_pairs(config, pairs)
    rows = [*score_pairs(config, checked, draws, every=every, protocols=PROTOCOLS)]
    limits = choose_limits(rows)
    confidence = fit_confidence(at_limits(rows, limits))
    if (Path(config.data.path) / "test").is_dir():
        reported = open_radarhd(config.data.path, split="test")
        where = "test trajectories"
    else:
        reported = pairs.of(config.data.report_trajectories)
        where = f"trajectories {config.data.report_trajectories}, not trained on"
    title = f"{config.purpose}; {where}"
    write_results(config, workdir, title, reported, draws, limits, confidence)


def threshold_pairs(config: ConfigDict, pairs: RadarHD) -> RadarHD:
    """Return the pairs on which limits are chosen."""
    with build.section("data.threshold_trajectories"):
        return pairs.of(config.data.threshold_trajectories)


def quickest(draws: dict[str, Draw]) -> dict[str, Draw]:
    """Return the first method alone."""
    name = next(iter(draws))
    return {name: draws[name]}


def draw_methods(config: ConfigDict, params: dict) -> dict[str, Draw]:
    """Return functions (key, conditions) -> images by method, the quickest first."""
    network, noise = networks(config)

    def drawn(steps):
        return functools.partial(
            draw_images, params=params, network=network, noise=noise, steps=steps
        )

    if config.method == "regression":
        return {"direct regression": drawn(None)}
    if config.method == "nearness":
        both = functools.partial(mirrored, drawn(None))
        return {"one pass": drawn(None), "one pass and its mirror image": both}
    steps, draws = config.sampling.steps, config.sampling.draws
    solver = {"heun": "Heun", "ipndm3": "iPNDM"}[diffusion.solver_for(steps).name]
    methods = {
        "one-step estimate": drawn(1),
        "one pass from zero": drawn(None),
        f"diffusion, {solver} {steps}": drawn(steps),
    }
    if draws > 1:
        agreed = shared(functools.partial(agreed_images, drawn(QUICK_STEPS), draws))
        methods[f"{draws} draws"] = agreed
        if config.nearness.weights:
            near = nearness_images(config)
            both = functools.partial(mean_images, agreed, near)
            methods[f"{draws} draws and nearness"] = both
    return methods


def nearness_images(config: ConfigDict) -> Draw:
    """Return the one-pass method, mirror images included, of `config.nearness`."""
    with build.section("nearness.network"):
        network = diffusion.build_network(**config.nearness.network)
    path = Path(config.nearness.weights)
    one_pass = functools.partial(
        draw_images,
        params=fitting_weights(path, network, config.data.history),
        network=network,
        noise=networks(config)[1],
        steps=None,
    )
    return functools.partial(mirrored, one_pass)


def fitting_weights(path: Path, network: diffusion.Network, history: int) -> Any:
    """Return the parameters in a file.

    Raises ModelError without them, and for those of another network or history.
    """
    params = load_weights(path)
    image, condition = (1, *LIDAR.shape, 1), (1, *RADAR.shape, history)
    wanted = jax.eval_shape(
        network.init,
        jax.random.key(0),
        *map(jnp.zeros, (image, (1,), condition)),
    )
    found, expected = map(_shapes, (params, wanted))
    wrong = sorted(n for n in found | expected if found.get(n) != expected.get(n))
    if wrong:
        first = wrong[0]
        raise ModelError(
            f"{path} does not fit the network with data.history = {history}: {first} "
            f"is {found.get(first, 'missing')}, expected "
            f"{expected.get(first, 'no such parameter')} ({len(wrong)} differ)"
        )
    return params


def _shapes(params: Any) -> dict[str, tuple[int, ...]]:
    """The shape of each parameter by its name."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(params)
    return {
        jax.tree_util.keystr(path, simple=True, separator="/"): leaf.shape
        for path, leaf in leaves
    }


def mean_images(first: Draw, second: Draw, key: jax.Array, condition: Any) -> jax.Array:
    """Return the mean of the images of two methods."""
    return (first(key, condition) + second(key, condition)) / 2


def shared(draw: Draw) -> Draw:
    """Return a method that draws once when it is called again with the same arrays."""
    last: list[Any] = [None, None, None]

    def images(key, condition):
        if last[0] is not key or last[1] is not condition:
            last[:] = key, condition, draw(key, condition)
        return last[2]

    return images


def agreed_images(draw: Draw, draws: int, key: jax.Array, condition: Any) -> jax.Array:
    """Return the share of draws that have an occupied pixel near each pixel."""
    keys = jax.random.split(key, draws)
    return agreed_occupancy(jnp.stack([draw(key, condition) for key in keys]))


@functools.partial(jax.jit, static_argnames=("network", "noise", "steps"))
def draw_images(
    key: Key[Array, ""],
    condition: Float[Array, "batch row column channel"],
    *,
    params: Any,
    network: diffusion.Network,
    noise: diffusion.NoiseSpec,
    steps: int | None,
) -> Float[Array, "batch lidar_row lidar_column"]:
    """Return an image for each condition: regressed if `steps` is None, else drawn."""
    denoise = diffusion.conditional_denoiser(network, params, noise)(condition)
    shape = (len(condition), *LIDAR.shape, 1)
    if steps is None:
        return diffusion.regression_estimate(denoise, shape, noise=noise)[..., 0]
    return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)[..., 0]
