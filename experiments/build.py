"""Configs to data, specs, network, optimiser and loss.

Data are records of `jradar prepare`. When a config names none, the run simulates a set
and prepares it in its own workdir, with the functions behind the commands.

A mistake in a config raises UsageError, which names the section of the config.
"""

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax
from ml_collections import ConfigDict

from jradar import data, diffusion
from jradar.errors import UsageError
from jradar.fields import typed_fields
from jradar.lidar import LidarSpec
from jradar.model import Card, ModelSpec, ViewGrid
from jradar.progress import progress
from jradar.radar import PointSpec
from jradar.range_image import ImageSpec
from jradar.simulation import drawn_sources, set_sequences, simulate_set
from jradar.simulation.drawn import DRAWN, kind_of
from jradar.training import LOSSES, Loss, clipped_adamw, view_losses

TRAIN_KEY, INIT_KEY, SAMPLE_KEY = range(3)


def random_key(config: ConfigDict, use: int) -> jax.Array:
    """Return the run's key for one of TRAIN_KEY, INIT_KEY and SAMPLE_KEY."""
    # The generator "rbg" halves the time to compile a network's initialisation.
    kind = "rbg" if use == INIT_KEY else None
    return jax.random.fold_in(jax.random.key(config.seed, impl=kind), use)


@contextlib.contextmanager
def section(name: str) -> Iterator[None]:
    """Turn a ValueError about values of a config's section into a UsageError."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise UsageError(f"config.{name}: {error}") from error


def prepared_data(
    config: ConfigDict,
    workdir: Path,
    *,
    write: Callable[[ConfigDict, Path], None] | None = None,
) -> Path:
    """Return the folder of records: the config's, or one made in the workdir.

    `write(config, folder)` makes the recordings; by default the config's whole set.
    """
    if config.data.path:
        return Path(config.data.path)
    if not config.data.set:
        raise UsageError(
            "this config needs recordings: prepare them with `jradar prepare`, and "
            "pass the folder as --config.data.path"
        )
    recordings, records = workdir / "data" / "recordings", workdir / "data" / "records"
    with contextlib.suppress(FileNotFoundError, ValueError):  # missing or incomplete
        return data.Records(records).folder
    if jax.process_count() > 1:
        raise UsageError(
            "several processes cannot simulate their own data: prepare it beforehand, "
            "and pass the folder as --config.data.path"
        )
    if config.data.set in DRAWN:
        draw_places(config, records)
        return records
    if write:
        write(config, recordings)
    else:
        simulate(config.data.set, recordings, frames=config.data.frames)
    data.prepare(recordings, records, prepare_spec(config), workers=1)
    return records


def draw_places(config: ConfigDict, folder: Path, *, workers: int = 1) -> None:
    """Simulate and prepare a set whose frames each have a place of their own."""
    sources = drawn_sources(config.data.set, maps=config.data.maps)
    data.prepare_sources(sources, folder, prepare_spec(config), workers=workers)


def records_of(config: ConfigDict, folder: Path, split: str) -> data.Records:
    """Return the records of a split; see `data.without`.

    Only the kinds that are left out of training and validation are tested.
    """
    left = set(filter(None, config.data.get("without", "").split(",")))
    if not left:
        return data.Records(folder, split)
    kinds = {kind_of(name) for name, _ in data.Records(folder).where}
    if unknown := sorted(left - kinds):
        raise UsageError(
            f"data.without = {unknown[0]!r}, expected one of {sorted(kinds)}"
        )
    wanted = split == "test"
    return data.Records(
        folder, split, choose=lambda name: (kind_of(name) in left) == wanted
    )


def simulate(name: str, folder: Path, *, frames: int) -> None:
    """Write the missing recordings of a set, and show the progress."""
    with section("data"):
        total, done = frames * len(set_sequences(name)), itertools.count(1)
    with progress("simulating", total, unit="frames") as show:
        simulate_set(name, folder, frames=frames, advance=lambda: show(next(done)))


def prepare_spec(config: ConfigDict) -> data.PrepareSpec:
    """Return the options of preparation, for the field of view of the images."""
    with section("prepare"):
        return data.PrepareSpec(
            points=PointSpec(**config.points),
            lidar=LidarSpec(**field_of_view(config.image)),
            **config.prepare,
        )


def field_of_view(image: ConfigDict) -> dict[str, Any]:
    """Return the field of view of both images, in radians and metres."""
    return {
        "azimuth": tuple(math.radians(angle) for angle in image.azimuth_deg),
        "elevation": tuple(math.radians(angle) for angle in image.elevation_deg),
        "max_range_m": image.max_range_m,
    }


def build_images(image: ConfigDict) -> tuple[ImageSpec, ImageSpec]:
    """Return the grids of the condition (coarse) and of the target (fine)."""
    view = field_of_view(image)
    with section("image"):
        return ImageSpec(*image.coarse, **view), ImageSpec(*image.fine, **view)


def build_noise(
    config: ConfigDict, *, predictions: Any = diffusion.PREDICTIONS
) -> diffusion.NoiseSpec:
    """Return the noise levels and the prediction, which is looked up by its name."""
    fields = config.noise.to_dict()
    name = fields.pop("prediction")
    if name not in predictions:
        raise UsageError(
            f"noise.prediction = {name!r}, expected one of {[*predictions]}"
        )
    with section("noise"):
        return diffusion.NoiseSpec(**fields, prediction=predictions[name])


def build_network(config: ConfigDict) -> diffusion.Network:
    """Return the network: a preset with the config's changes, for its prediction."""
    fields = {"outputs": 2 * build_noise(config).prediction.outputs_per_channel}
    if config.network.get("kind") == "evidence":
        fields |= field_of_view(config.image) | {"codec": config.image.codec}
        fields["parts"] = len(config.image.channels)
    with section("network"):
        return diffusion.build_network(**{**fields, **config.network})


def build_solver(config: ConfigDict) -> diffusion.Solver:
    """Return the config's solver of the sampling equation."""
    name = config.sampling.solver
    if name not in diffusion.SOLVERS:
        raise UsageError(
            f"sampling.solver = {name!r}, expected one of {[*diffusion.SOLVERS]}"
        )
    return diffusion.SOLVERS[name]


def build_spec(config: ConfigDict, records: data.Records) -> ModelSpec:
    """Return everything about the model except its weights."""
    options = records.manifest["options"]
    view = field_of_view(config.image)
    seen = {name: tuple(np.ravel(options["lidar"][name]).tolist()) for name in view}
    if any(tuple(np.ravel(view[name])) != seen[name] for name in view):
        raise UsageError(
            f"config.image has the field of view {view}, the records were prepared for "
            f"{seen}: prepare them again, or change config.image"
        )
    if options["points"]["angles"] != "fft":
        raise UsageError(
            f"{records.folder} has directions by {options['points']['angles']}, but "
            "models are used with directions by fft: train on records with that"
        )
    if records.of_points:
        raise UsageError(
            f"{records.folder} holds the points that a radar sent, expected records of "
            "its samples: `jradar finetune` takes points"
        )
    points = PointSpec(**typed_fields(PointSpec, options["points"]))
    coarse, fine = build_images(config.image)
    with section("image"):
        grid = ViewGrid(
            coarse,
            fine,
            num_slices=config.image.num_slices,
            codec=config.image.codec,
            validity_threshold=config.sampling.validity_threshold,
            channels=tuple(config.image.channels),
        )
    with section("method"):
        return ModelSpec(
            method=config.method,
            network=build_network(config),
            noise=build_noise(config),
            grid=grid,
            points=points.fitted(records.radar),
            temperature=config.sampling.temperature,
        )


def build_card(config: ConfigDict, records: data.Records) -> Card:
    """Return the card, which describes the training to the model's users."""
    return Card(
        purpose=config.purpose,
        steps_seen=config.train.steps_before + config.train.steps,
        trained_on=f"{len(records)} frames {records.digest[:12]}",
        radars=(records.radar, *records.other_radars),
        sent_points=config.history.sparse > 0,
    )


def build_history(config: ConfigDict) -> data.HistorySpec:
    """Return whose points the conditions of training hold."""
    with section("history"):
        return data.HistorySpec(**config.history)


def build_augment(config: ConfigDict) -> data.AugmentSpec:
    """Return how frames change in training.

    Raises UsageError for a view that cannot be mirrored.
    """
    fields = config.augment.to_dict()
    low, high = config.image.azimuth_deg
    if fields["mirror"] and low != -high:
        raise UsageError(
            f"image.azimuth_deg = ({low:g}, {high:g}) cannot be mirrored: expected the "
            "same angle to both sides, or augment.mirror = False"
        )
    with section("augment"):
        rotation = math.radians(fields.pop("rotation_deg"))
        return data.AugmentSpec(rotation=rotation, **fields)


def build_optimizer(train: ConfigDict) -> optax.GradientTransformation:
    """Return the optimiser of the config's section `train`."""
    names = ("steps", "learning_rate", "warmup_steps", "clip_norm", "weight_decay")
    with section("train"):
        return clipped_adamw(**{name: train[name] for name in names})


def loss_of(grid: str, method: str) -> Loss:
    """Return the training loss of a method on a grid."""
    return _chosen(LOSSES[grid], method)


def build_loss(loss: ConfigDict, *, method: str) -> Loss:
    """Return the loss of range images, with the config's weights.

    LPIPS is loaded if its weight is not 0.
    """
    weights = dict(loss)
    network, perceptual = weights.pop("perceptual_network"), None
    with section("loss"):
        spec = diffusion.LossSpec(**weights)
        if spec.perceptual and method == "diffusion":
            loaded = diffusion.load_lpips(network=network)
            perceptual = functools.partial(diffusion.lpips, loaded)
    return _chosen(view_losses(weights=spec, perceptual=perceptual), method)


def _chosen(losses, method):
    if method not in losses:
        raise UsageError(f"{method = }, expected one of {[*losses]}")
    return losses[method]
