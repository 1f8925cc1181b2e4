"""The task `pretrain`: an unconditional prior for the main network, from photographs.

A crop's luminance, -1 .. 1, takes the place of the range, and every pixel is valid; the
condition is empty, and its tower, which learns nothing from that, is no part of the
prior. Crops are a pure function of the seed, the step and the photographs.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from ml_collections import ConfigDict

from experiments.build import (
    INIT_KEY,
    SAMPLE_KEY,
    TRAIN_KEY,
    build_network,
    build_optimizer,
    check_workdir,
    initial_weights,
    start_from,
)
from experiments.tasks.photographs import Photographs, crop
from jradar import diffusion, training, viz
from jradar.files import write_text

CHECKED, SHOWN = 16, 4  # crops of photographs that were kept apart
LEVELS = (0.05, 0.2, 0.8, 3.2)  # of noise, in the table
PRIOR = "prior.safetensors"


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the prior, evaluate it. Resumes where the workdir stands."""
    network = build_network(config)
    initial_weights(config.train)  # a missing file shows before anything is written
    photographs, chosen, apart = open_photographs(config)
    check_workdir(config, workdir)
    print(f"{len(chosen)} photographs to train on", file=sys.stderr, flush=True)
    noise = diffusion.NoiseSpec(**config.noise)
    optimizer = build_optimizer(config.train)
    image, _, condition = _inputs(config)
    state = training.create_state(
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        network,
        optimizer,
        image_shape=image.shape[1:],
        condition_shape=condition.shape[1:],
    )
    state = start_from(config.train, network, state)
    checked = checked_batch(config, photographs, apart)
    key = jax.random.key(config.seed)

    @jax.jit
    def score(params):
        denoise = diffusion.conditional_denoiser(network, params, noise)
        return diffusion.denoising_loss(
            jax.random.fold_in(key, SAMPLE_KEY),
            denoise(checked.condition),
            checked.target,
            noise=noise,
        )

    def evaluate(state, step):
        if not jax.process_index():
            diffusion.save_prior(workdir / PRIOR, network, state.ema_params)
        return {"loss": float(score(state.ema_params))}

    training.train(
        jax.random.fold_in(key, TRAIN_KEY),
        state,
        training.make_train_step(
            network, optimizer, noise, ema_decay=config.train.ema_decay
        ),
        lambda step: batch_at(config, photographs, chosen, step),
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
        evaluate_every=config.train.evaluate_every,
        evaluate=evaluate,
    )
    if jax.process_index():
        return
    training.write_model_card(
        workdir,
        config=config.to_dict(),
        data_digest=photographs.digest,
        seed=config.seed,
        steps=config.train.steps,
        purpose=f"a prior from {len(chosen)} photographs",
    )
    run_evaluation(config, workdir)


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """What the workdir's prior makes of noisy photographs, and draws from noise."""
    network = build_network(config)
    noise = diffusion.NoiseSpec(**config.noise)
    photographs, _, apart = open_photographs(config)
    checked = checked_batch(config, photographs, apart)
    path = initial_weights(ConfigDict({"initial": str(workdir)}))
    shapes = jax.eval_shape(network.init, jax.random.key(0), *_inputs(config))
    empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    params, _ = diffusion.load_pretrained(path, network, empty)
    given = diffusion.conditional_denoiser(network, params, noise)
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)

    @jax.jit
    def draw(key):
        denoise = given(checked.condition[:SHOWN])
        shape, steps = checked.target[:SHOWN].shape, config.sampling.steps
        return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)

    out = workdir / "evaluation"
    table = denoising_table(key, given(checked.condition), checked.target)
    write_text(out / "table.md", table)
    images = {"photographs": checked.target[:SHOWN], "drawn from noise": draw(key)}
    viz.save_figure(picture(images), out / "samples.png")
    print(f"{table}\nwritten to {out}")


def open_photographs(
    config: ConfigDict,
) -> tuple[Photographs, Sequence[int], Sequence[int]]:
    """The config's photographs, those to train on and those kept apart."""
    if not config.data.path:
        raise ValueError("no photographs: name a folder of them as --config.data.path")
    photographs = Photographs(config.data.path, smallest=tuple(config.image.fine))
    for path, fault in photographs.skipped.items():
        print(f"left out {path}: {fault}", file=sys.stderr)
    every, count = config.data.validation, len(photographs)
    if not 2 <= every <= count:
        raise ValueError(
            f"data.validation = {every} of {count} photographs: expected 2 to {count}"
        )
    apart = range(0, count, every)
    return photographs, [i for i in range(count) if i not in apart], apart


def _inputs(config):
    """One image, noise level and condition, all zero."""
    image, condition = (*config.image.fine, 2), (*config.image.coarse, 1)
    return jnp.zeros((1, *image)), jnp.zeros(1), jnp.zeros((1, *condition))


def batch_at(
    config: ConfigDict, photographs: Photographs, chosen: Sequence[int], step: int
) -> training.Batch:
    """Crops of photographs that are drawn from `chosen`."""
    rng = np.random.default_rng([config.seed, step])
    index = [chosen[i] for i in rng.integers(len(chosen), size=config.train.batch_size)]
    return _batch(config, [crop(rng, photographs[i], config.image.fine) for i in index])


def checked_batch(
    config: ConfigDict, photographs: Photographs, apart: Sequence[int]
) -> training.Batch:
    """The same crops at any time, from all photographs that were kept apart in turn."""
    rng = np.random.default_rng(config.seed)
    index = np.resize(apart, CHECKED)
    crops = [crop(rng, photographs[i], config.image.fine) for i in index]
    return jax.tree.map(jnp.asarray, _batch(config, crops))


def _batch(config, crops):
    """Luminance and validity under an empty condition."""
    luminance = np.stack(crops)
    condition = np.zeros((len(crops), *config.image.coarse, 1), np.float32)
    target = np.stack([luminance, np.ones_like(luminance)], -1)
    return training.Batch(condition, target)


def denoising_table(
    key: jax.Array,
    denoise: diffusion.Denoiser,
    clean: Float[np.ndarray, "batch row column 2"],
) -> str:
    """Errors (rms) of the luminance before and after denoising, by level, as Markdown.

    The mean of the photographs is what is known without looking.
    """

    @jax.jit
    def error(sigma):
        noisy = clean + sigma * jax.random.normal(key, clean.shape)
        away = (denoise(noisy, sigma) - clean)[..., 0]
        return jnp.sqrt(jnp.mean(away**2))

    lines = ["| noise | after denoising | the mean instead |", "|---|---|---|"]
    mean = float(clean[..., 0].std())
    for sigma in LEVELS:
        lines.append(f"| {sigma} | {float(error(sigma)):.4f} | {mean:.4f} |")
    return "\n".join(lines) + "\n"


def picture(images: dict[str, Any]) -> Figure:
    """Luminances, a column for each name."""
    figure = Figure(figsize=(6 * len(images), 1.7 * SHOWN), layout="constrained")
    for column, (name, batch) in enumerate(images.items()):
        for row, image in enumerate(np.asarray(batch)[..., 0]):
            axes = figure.add_subplot(
                SHOWN, len(images), 1 + row * len(images) + column
            )
            axes.imshow(image, cmap="gray", vmin=-1, vmax=1)
            axes.set_axis_off()
            if not row:
                axes.set_title(name)
    return figure
