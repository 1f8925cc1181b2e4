"""Configs to specs, data, network and runs: the only place that reads a config."""

import hashlib
import json
import math
import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
import optax
from ml_collections import ConfigDict

from jradar import diffusion, evaluation, training, viz
from jradar.bundle import Bundle, BundleSpec, load_bundle, save_bundle
from jradar.data import Pairs, batch_indices, make_pairs, valid_points
from jradar.files import write_text
from jradar.pipeline import draw_range_image
from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec, encode_target, project, unproject

DATA_KEY, TRAIN_KEY, INIT_KEY, SAMPLE_KEY = range(4)
FRAMES_IN_FIGURE = 4


def build_spec(config: ConfigDict) -> BundleSpec:
    """Everything about the model but its weights."""
    image = config.image
    view = {
        "azimuth": tuple(math.radians(angle) for angle in image.azimuth_deg),
        "elevation": tuple(math.radians(angle) for angle in image.elevation_deg),
        "max_range_m": image.max_range_m,
    }
    network = dict(config.network)
    preset = network.pop("preset")
    if preset not in diffusion.PRESETS:
        raise ValueError(
            f"network.preset = {preset!r}, expected one of {[*diffusion.PRESETS]}"
        )
    data = {k: config[k].to_dict() for k in ("radar", "image", "points", "data")}
    data["seed"] = config.seed
    return BundleSpec(
        network=diffusion.UNet(**{**diffusion.PRESETS[preset], **network}),
        noise=diffusion.NoiseSpec(**config.noise),
        coarse=ImageSpec(*image.coarse, **view),
        fine=ImageSpec(*image.fine, **view),
        radar=RadarSpec.from_dict(config.radar.to_dict()),
        num_slices=image.num_slices,
        codec=image.codec,
        steps_seen=config.train.steps,
        trained_on=f"simulated rooms {_digest(data)}",
        purpose=config.purpose,
        validity_threshold=config.sampling.validity_threshold,
        points=config.points.to_dict(),
    )


def build_pairs(config: ConfigDict, spec: BundleSpec, split: str) -> Pairs:
    """Pairs of the "train" or the "validation" split."""
    num_frames = config.data[f"num_{split}"]
    print(f"simulating {num_frames} {split} frames", file=sys.stderr, flush=True)
    key = jax.random.fold_in(jax.random.key(config.seed), DATA_KEY)
    return make_pairs(
        jax.random.fold_in(key, ("train", "validation").index(split)),
        num_frames,
        radar=spec.radar,
        coarse=spec.coarse,
        fine=spec.fine,
        num_slices=spec.num_slices,
        points=spec.points,
        baseline=config.baseline.to_dict(),
    )


def build_optimizer(train: ConfigDict) -> optax.GradientTransformation:
    """Adam behind a clipped gradient, with a warm-up of the learning rate."""
    rate = optax.linear_schedule(0.0, train.learning_rate, train.warmup_steps)
    return optax.chain(optax.clip_by_global_norm(train.clip_norm), optax.adam(rate))


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the bundle, evaluate it. Resumes where the workdir stands."""
    spec = build_spec(config)
    _check_workdir(config, workdir)
    pairs = build_pairs(config, spec, "train")
    target = encode_target(pairs.lidar, spec.fine, codec=spec.codec)
    target = np.asarray(target)

    key = jax.random.key(config.seed)
    optimizer = build_optimizer(config.train)
    state = training.create_state(
        # This generator compiles in half the time for a network's many parameters.
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        spec.network,
        optimizer,
        image_shape=target.shape[1:],
        condition_shape=pairs.condition.shape[1:],
    )

    def batch_at(step):
        index = batch_indices(
            config.seed,
            step,
            batch_size=config.train.batch_size,
            num_frames=len(target),
        )
        return training.Batch(pairs.condition[index], target[index])

    state = training.train(
        jax.random.fold_in(key, TRAIN_KEY),
        state,
        training.make_train_step(
            spec.network, optimizer, spec.noise, ema_decay=config.train.ema_decay
        ),
        batch_at,
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
    )
    save_bundle(workdir / "bundle", Bundle(state.ema_params, spec))
    run_evaluation(config, workdir)


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's bundle on the validation split; table, scores, picture."""
    params, spec = load_bundle(workdir / "bundle")
    pairs = build_pairs(config, spec, "validation")
    denoise = diffusion.conditional_denoiser(spec.network, params, spec.noise)

    def draw(steps):
        return jax.jit(
            lambda key, condition: draw_range_image(
                key,
                condition,
                denoise,
                fine=spec.fine,
                noise=spec.noise,
                codec=spec.codec,
                validity_threshold=config.sampling.validity_threshold,
                steps=steps,
            )
        )

    one_step, sampled = draw(1), draw(config.sampling.steps)
    names = {
        "radar": f"{config.baseline.detector.upper()}-CFAR",
        "one_step": "one-step estimate",
        "sampled": f"jradar, Heun {config.sampling.steps}",
    }
    methods = {
        names["radar"]: lambda _, pair: pair.radar,
        names["one_step"]: lambda key, pair: unproject(
            one_step(key, pair.condition), spec.fine
        ),
        names["sampled"]: lambda key, pair: unproject(
            sampled(key, pair.condition), spec.fine
        ),
    }
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    frames = [jax.tree.map(lambda x, i=i: x[i], pairs) for i in range(len(pairs.lidar))]
    scores = evaluation.score_frames(
        key,
        frames,
        methods,
        truths={"LiDAR": lambda pair: unproject(pair.lidar, spec.fine)},
        scene="simulated rooms",
    )
    folder = workdir / "evaluation"
    evaluation.write_scores(folder / "frames.jsonl", scores)
    evaluation.write_tables(folder / "frames.jsonl")
    table = evaluation.markdown(
        evaluation.summarise(evaluation.read_scores(folder / "frames.jsonl"))
    )

    shown = frames[:FRAMES_IN_FIGURE]
    columns = {}
    kept = {("simulated rooms", "", i): {} for i in range(len(shown))}
    drawn = {"LiDAR": lambda _, pair: unproject(pair.lidar, spec.fine), **methods}
    for name, method in drawn.items():
        clouds = [
            method(jax.random.fold_in(key, i), pair) for i, pair in enumerate(shown)
        ]
        columns[name] = np.stack([project(cloud, spec.fine) for cloud in clouds])
        for named, cloud in zip(kept.values(), clouds, strict=True):
            named[name] = valid_points(cloud)["xyz"]
    evaluation.save_clouds(folder / "clouds.npz", kept)
    viz.save_figure(viz.samples_figure(columns, spec.fine), folder / "samples.png")
    evaluation.build_report(workdir)
    print(f"{spec.purpose}\n\n{table}\nwritten to {folder}")


def _check_workdir(config, workdir):
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


def _digest(values):
    """A short digest of what the data was made from."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]
