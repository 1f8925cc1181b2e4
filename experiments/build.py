"""Configs to data, specs, optimiser and loss of the main task.

Data are records of `jradar prepare`. Where a config names none, a run simulates a set
and prepares it in its own workdir, by the same functions as the commands.
"""

import contextlib
import functools
import itertools
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax
from ml_collections import ConfigDict

from jradar import data, diffusion, training
from jradar.baselines import regression_loss
from jradar.bundle import BundleError, BundleSpec
from jradar.files import write_text
from jradar.lidar import LidarSpec
from jradar.progress import progress
from jradar.radar import azimuth_bins
from jradar.range_image import ImageSpec
from jradar.simulation import set_sequences, simulate_set

TRAIN_KEY, INIT_KEY, SAMPLE_KEY = range(3)


def prepared_data(config: ConfigDict, workdir: Path) -> Path:
    """The folder of records: the config's, or one simulated and prepared here."""
    if config.data.path:
        return Path(config.data.path)
    if not config.data.set:
        raise ValueError(
            "this config is for recordings of your own: prepare them with `jradar "
            "prepare`, and name the folder as --config.data.path"
        )
    recordings, records = workdir / "data" / "recordings", workdir / "data" / "records"
    with contextlib.suppress(FileNotFoundError, ValueError):  # not there or not whole
        return data.Records(records).folder
    if jax.process_count() > 1:
        raise ValueError(
            "several processes cannot make their own data: prepare it once, and name "
            "the folder as --config.data.path"
        )
    frames, done = config.data.frames, itertools.count(1)
    total = frames * len(set_sequences(config.data.set))
    with progress("simulating", total, unit="frames") as show:
        simulate_set(
            config.data.set,
            recordings,
            frames=frames,
            advance=lambda: show(next(done)),
        )
    prepare(config, recordings, records)
    return records


def prepare(config: ConfigDict, recordings: Path, records: Path) -> None:
    """Prepare recordings as the config says, for the field of view of its images."""
    spec = data.PrepareSpec(
        **config.prepare.to_dict(), lidar=LidarSpec(**view(config.image))
    )
    data.prepare(recordings, records, spec, workers=1)


def build_spec(config: ConfigDict, records: data.Records) -> BundleSpec:
    """Everything about the model but its weights."""
    image, options = config.image, records.manifest["options"]
    sees = view(image)
    seen = {name: tuple(np.ravel(options["lidar"][name]).tolist()) for name in sees}
    if any(tuple(np.ravel(sees[name])) != seen[name] for name in sees):
        raise ValueError(
            f"image sees {sees}, the data were prepared for {seen}: expected the same"
        )
    if options.get("angles", "fft") != "fft":
        raise ValueError(
            f"{records.folder} has directions by {options['angles']}, which models are "
            "not given when they are used: train on records with angles = 'fft'"
        )
    points = ("capacity", "detector", "false_alarm_rate", "guard", "train")
    flips = ("flip_azimuth", "flip_elevation")
    return BundleSpec(
        network=build_network(config),
        noise=diffusion.NoiseSpec(**config.noise),
        coarse=ImageSpec(*image.coarse, **sees),
        fine=ImageSpec(*image.fine, **sees),
        radar=records.radar,
        num_slices=image.num_slices,
        codec=image.codec,
        steps_seen=config.train.steps,
        trained_on=f"{len(records)} frames {records.digest[:12]}",
        purpose=config.purpose,
        validity_threshold=config.sampling.validity_threshold,
        temperature=config.sampling.temperature,
        points={
            name: tuple(value) if isinstance(value, list) else value
            for name, value in options.items()
            if name in (*points, *flips)
        }
        | {"num_azimuth": azimuth_bins(records.radar)},
    )


def build_network(config: ConfigDict) -> diffusion.UNet:
    """A preset, with whatever the config says differently, for its prediction."""
    fields = dict(config.network)
    preset = fields.pop("preset")
    if preset not in diffusion.PRESETS:
        raise ValueError(
            f"network.preset = {preset!r}, expected one of {[*diffusion.PRESETS]}"
        )
    outputs = 4 if config.noise.prediction == "gaussian" else 2
    return diffusion.UNet(**diffusion.PRESETS[preset] | {"outputs": outputs} | fields)


def initial_weights(train: ConfigDict) -> Path | None:
    """The file that training starts from; None where it starts from random weights.

    Raises ValueError for an empty name, BundleError where a folder holds no weights.
    """
    if train.initial is None:
        return None
    if not train.initial:
        raise ValueError("no weights to start from: name them, --config.train.initial=")
    path = Path(train.initial)
    names = ("prior.safetensors", "bundle/weights.safetensors", "weights.safetensors")
    files = [path] if path.is_file() else [path / name for name in names]
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        raise BundleError(
            f"no weights at {path}: expected a file, a bundle, or the workdir of a run "
            f"with one of {names}"
        )
    return found


def start_from(
    train: ConfigDict, network: diffusion.UNet, state: training.TrainState
) -> training.TrainState:
    """The state with the parameters that `train.initial` names; says what it took."""
    path = initial_weights(train)
    if path is None:
        return state
    params, report = diffusion.load_pretrained(
        path, network, state.params, attention_order=train.attention_order
    )
    counts = {name: len(names) for name, names in report._asdict().items()}
    new = sorted({"/".join(name.split("/")[:2]) for name in report.new})
    print(
        f"starting from {path}: {counts['loaded']} parameters loaded, {counts['new']} "
        f"new {new}, {counts['unused']} of the file's not used {[*report.unused]}",
        file=sys.stderr,
        flush=True,
    )
    return state._replace(params=params, ema_params=params)


def build_pairs(spec: BundleSpec, records: Any) -> data.PairSource:
    """Images of the records, as the model's spec has them."""
    return data.PairSource(records, spec.coarse, spec.fine, num_slices=spec.num_slices)


def build_optimizer(train: ConfigDict) -> optax.GradientTransformation:
    """AdamW behind a clipped gradient; the rate warms up, then falls as a cosine."""
    warmup = min(train.warmup_steps, train.steps // 2)
    rate = optax.warmup_cosine_decay_schedule(
        0.0, train.learning_rate, warmup, train.steps
    )
    return optax.chain(
        optax.clip_by_global_norm(train.clip_norm),
        optax.adamw(rate, weight_decay=train.weight_decay),
    )


def build_loss(
    loss: ConfigDict, *, method: str = "diffusion"
) -> Callable[..., jax.Array]:
    """Eq. 12 with the config's weights; LPIPS is loaded where it has one.

    The method "regression" has a squared error of its own, and no other terms.
    """
    if method == "regression":
        return functools.partial(regression_loss, range_weight=loss.range_weight)
    if method != "diffusion":
        raise ValueError(f"{method=}, expected diffusion or regression")
    weights = dict(loss)
    network, masked = weights.pop("perceptual_network"), weights.pop("mask_misses")
    perceptual = None
    if weights["perceptual"]:
        perceptual = functools.partial(
            diffusion.lpips, diffusion.load_lpips(network=network)
        )
    spec = diffusion.LossSpec(**weights)

    def denoising(key, denoise, clean, **given):
        return diffusion.denoising_loss(
            key,
            denoise,
            clean,
            weights=spec,
            mask=diffusion.target_mask(clean) if masked else None,
            perceptual=perceptual,
            **given,
        )

    return denoising


def view(image: ConfigDict) -> dict[str, Any]:
    """The field of view of both images, in radians and metres."""
    return {
        "azimuth": tuple(math.radians(angle) for angle in image.azimuth_deg),
        "elevation": tuple(math.radians(angle) for angle in image.elevation_deg),
        "max_range_m": image.max_range_m,
    }


def check_mirror(config: ConfigDict) -> None:
    """Refuse to mirror pairs whose view is wider to one side."""
    low, high = config.image.azimuth_deg
    if config.train.mirror and low != -high:
        raise ValueError(
            f"image.azimuth_deg = ({low:g}, {high:g}) is no view to mirror: expected "
            "the same to both sides, or train.mirror = False"
        )


def check_workdir(config: ConfigDict, workdir: Path) -> None:
    """Refuse to go on with another config than the workdir was started with."""
    path = workdir / "config.json"
    wanted = _flatten(json.loads(config.to_json()))
    if path.exists():
        found = _flatten(json.loads(path.read_text()))
        changed = sorted(k for k in wanted | found if wanted.get(k) != found.get(k))
        if changed:
            key = changed[0]
            raise ValueError(
                f"{workdir} was started with another config: {key} was "
                f"{found.get(key)}, now {wanted.get(key)} ({len(changed)} such); "
                "choose another --workdir"
            )
    else:
        write_text(path, config.to_json(indent=2) + "\n")


def _flatten(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Nested dictionaries as one, with dotted keys."""
    if not isinstance(tree, dict):
        return {prefix: tree}
    return {
        dotted: value
        for key, item in tree.items()
        for dotted, value in _flatten(item, f"{prefix}.{key}".lstrip(".")).items()
    }
