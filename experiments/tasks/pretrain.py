"""The task `pretrain`: an unconditional prior for the main network, from photographs.

A crop's luminance, -1 to 1, takes the place of the range, and every pixel is valid. The
condition is empty, so its tower learns nothing and is left out of the prior. Crops are
a pure function of the seed, the step and the photographs.
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

from experiments import build
from experiments.tables import markdown_table
from experiments.tasks.photographs import Photographs, crop
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import diffusion, training, viz
from jradar.errors import ModelError, UsageError
from jradar.files import write_text

VALIDATION_CROPS, SHOWN = 16, 4
LEVELS = (0.05, 0.2, 0.8, 3.2)  # of noise, in the table
PRIOR = "prior.safetensors"


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    build.build_network(config)
    initial_weights(config.train)
    if not config.data.path:
        raise UsageError("no photographs: pass a folder of them as --config.data.path")


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on crops of photographs."""
    network, noise = build.build_network(config), build.build_noise(config)
    optimizer = build.build_optimizer(config.train)
    photographs, chosen, kept = open_photographs(config)
    image, _, condition = _inputs(config)
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        network,
        optimizer,
        image_shape=image.shape[1:],
        condition_shape=condition.shape[1:],
    )
    batch = validation_batch(config, photographs, kept)

    @jax.jit
    def loss(params):
        denoise = diffusion.conditional_denoiser(network, params, noise)
        key = build.random_key(config, build.SAMPLE_KEY)
        return diffusion.denoising_loss(
            key, denoise(batch.condition), batch.target, noise=noise
        )

    return Training(
        state=start_from(config.train, network, state),
        step=training.make_train_step(
            network, optimizer, noise, ema_decay=config.train.ema_decay
        ),
        batch_at=lambda step: batch_at(config, photographs, chosen, step),
        validate=lambda state, _: {"loss": float(loss(state.ema_params))},
        save=lambda state: diffusion.save_prior(
            workdir / PRIOR, network, state.ema_params
        ),
        trained_on=f"{len(chosen)} photographs",
        data_digest=photographs.digest,
    )


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Write how well the workdir's prior denoises photographs, and what it draws."""
    network, noise = build.build_network(config), build.build_noise(config)
    path = workdir / PRIOR
    if not path.is_file():
        raise ModelError(f"no prior at {path}: train first, without --mode=eval")
    photographs, _, kept = open_photographs(config)
    batch = validation_batch(config, photographs, kept)
    shapes = jax.eval_shape(network.init, jax.random.key(0), *_inputs(config))
    empty = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    params, _ = diffusion.load_pretrained(path, network, empty)
    given = diffusion.conditional_denoiser(network, params, noise)
    key = build.random_key(config, build.SAMPLE_KEY)

    @jax.jit
    def draw(key):
        denoise = given(batch.condition[:SHOWN])
        shape, steps = batch.target[:SHOWN].shape, config.sampling.steps
        return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)

    out = workdir / "evaluation"
    table = denoising_table(key, given(batch.condition), batch.target)
    write_text(out / "table.md", table)
    images = {"photographs": batch.target[:SHOWN], "drawn from noise": draw(key)}
    viz.save_figure(picture(images), out / "samples.png")
    print(f"{table}\nwritten to {out}")


def open_photographs(
    config: ConfigDict,
) -> tuple[Photographs, Sequence[int], Sequence[int]]:
    """Return the config's photographs, and the indices to train and to validate on."""
    photographs = Photographs(config.data.path, smallest=tuple(config.image.fine))
    for path, fault in photographs.skipped.items():
        print(f"left out {path}: {fault}", file=sys.stderr)
    every, count = config.data.validation, len(photographs)
    if not 2 <= every <= count:
        raise UsageError(
            f"data.validation = {every} of {count} photographs: expected 2 to {count}"
        )
    kept = range(0, count, every)
    return photographs, [i for i in range(count) if i not in kept], kept


def _inputs(config):
    """One image, noise level and condition, all zero."""
    image, condition = (*config.image.fine, 2), (*config.image.coarse, 1)
    return jnp.zeros((1, *image)), jnp.zeros(1), jnp.zeros((1, *condition))


def batch_at(
    config: ConfigDict, photographs: Photographs, chosen: Sequence[int], step: int
) -> training.Batch:
    """Return crops of photographs drawn from `chosen`."""
    rng = np.random.default_rng([config.seed, step])
    index = [chosen[i] for i in rng.integers(len(chosen), size=config.train.batch_size)]
    return _batch(config, [crop(rng, photographs[i], config.image.fine) for i in index])


def validation_batch(
    config: ConfigDict, photographs: Photographs, kept: Sequence[int]
) -> training.Batch:
    """Return crops of the validation photographs in turn, the same at every call."""
    rng = np.random.default_rng(config.seed)
    index = np.resize(kept, VALIDATION_CROPS)
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
    """Return a Markdown table of the luminance's rms error after denoising, by level.

    The last column is the error of the photographs' mean, the best guess without an
    image.
    """

    @jax.jit
    def error(sigma):
        noisy = clean + sigma * jax.random.normal(key, clean.shape)
        difference = (denoise(noisy, sigma) - clean)[..., 0]
        return jnp.sqrt(jnp.mean(difference**2))

    mean = f"{float(clean[..., 0].std()):.4f}"
    rows = [[str(sigma), f"{float(error(sigma)):.4f}", mean] for sigma in LEVELS]
    return markdown_table(["noise", "after denoising", "the mean instead"], rows)


def picture(images: dict[str, Any]) -> Figure:
    """Return a figure with a column of luminances for each name."""
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
