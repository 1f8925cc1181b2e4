"""The task `enhance`: train the diffusion model on records, and compare it.

What is chosen by looking, the detectors' false-alarm rates, is chosen on the validation
split; the scores are those of the config's split.
"""

import functools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments.build import (
    INIT_KEY,
    SAMPLE_KEY,
    TRAIN_KEY,
    build_loss,
    build_network,
    build_optimizer,
    build_pairs,
    build_spec,
    check_workdir,
    prepared_data,
)
from jradar import data, diffusion, evaluation, training, viz
from jradar.bundle import Bundle, BundleSpec, load_bundle, save_bundle
from jradar.lidar import shared_field_of_view
from jradar.metrics import compare_on_host
from jradar.pipeline import draw_range_image
from jradar.progress import progress
from jradar.radar import DETECTORS, RadarSpec, cell_points, largest_window
from jradar.range_image import encode_target, unproject
from jradar.types import PointCloud

FRAMES_IN_FIGURE = 4
CLOUDS_IN_REPORT = 12
RATES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  # of false alarms, to choose from
Method = Callable[[jax.Array, "Frame"], PointCloud]


class Frame(NamedTuple):
    """What a method is given: the prepared frame and its images."""

    prepared: data.PreparedFrame
    pair: data.Pair


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the bundle, evaluate it. Resumes where the workdir stands."""
    build_network(config.network)  # what is wrong with it shows before the data
    check_workdir(config, workdir)
    records = data.Records(prepared_data(config, workdir), "train")
    spec = build_spec(config, records)
    source = build_pairs(spec, records)
    batches = data.Batches(source, seed=config.seed, batch_size=config.train.batch_size)
    print(f"{len(records)} training frames", file=sys.stderr, flush=True)
    encode = functools.partial(encode_target, spec=spec.fine, codec=spec.codec)
    first = source[0]
    optimizer = build_optimizer(config.train)
    state = training.create_state(
        # This generator compiles in half the time for a network's many parameters.
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        spec.network,
        optimizer,
        image_shape=(*first.lidar.shape, 2),
        condition_shape=first.condition.shape,
    )

    def batch_at(step):
        batch = batches[step]
        return training.Batch(batch.condition, np.asarray(encode(batch.lidar)))

    checked = data.Records(records.folder, "validation")

    def evaluate(state, step):
        return validate(config, Bundle(state.ema_params, spec), checked, workdir, step)

    state = training.train(
        jax.random.fold_in(jax.random.key(config.seed), TRAIN_KEY),
        state,
        training.make_train_step(
            spec.network,
            optimizer,
            spec.noise,
            loss=build_loss(config.loss),
            ema_decay=config.train.ema_decay,
        ),
        batch_at,
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
        evaluate_every=config.train.evaluate_every,
        evaluate=evaluate,
        best="chamfer",
    )
    if jax.process_index():
        return
    save_bundle(workdir / "bundle", Bundle(state.ema_params, spec))
    training.write_model_card(
        workdir,
        config=config.to_dict(),
        data_digest=records.digest,
        seed=config.seed,
        steps=config.train.steps,
        purpose=spec.purpose,
    )
    run_evaluation(config, workdir)


def validate(
    config: ConfigDict, bundle: Bundle, records: data.Records, workdir: Path, step: int
) -> dict[str, float]:
    """Scores of the one-step estimate on some validation frames, and a picture."""
    count = min(config.evaluation.frames_while_training, len(records))
    pairs = build_pairs(bundle.spec, records)
    index = np.linspace(0, len(records) - 1, count).astype(int).tolist()
    frames = [Frame(records[i], pairs[i]) for i in index]
    draw = build_methods(config, bundle)["one-step estimate"]
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    clouds = [draw(jax.random.fold_in(key, i), f) for i, f in enumerate(frames)]
    scores = [
        compare_on_host(_points(cloud), frame.prepared.lidar_xyz)
        for cloud, frame in zip(clouds, frames, strict=True)
    ]
    fine = bundle.spec.fine
    some = range(min(FRAMES_IN_FIGURE, count))
    columns = {
        "LiDAR": np.stack([frames[i].pair.lidar for i in some]),
        "one-step estimate": np.stack(
            [data.lidar_image(_points(clouds[i]), fine) for i in some]
        ),
    }
    figure = viz.samples_figure(columns, fine)
    viz.save_figure(figure, workdir / "samples" / f"{step:06d}.png")
    nothing = 2 * fine.max_range_m  # the Chamfer distance where there is no cloud
    return {
        "chamfer": float(
            np.mean([np.nan_to_num(s.chamfer, nan=nothing) for s in scores])
        ),
        "f_score_0.2": float(np.mean([np.nan_to_num(s.f_score[1]) for s in scores])),
    }


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's bundle beside the detectors: tables, pictures, a report."""
    bundle = load_bundle(workdir / "bundle")
    folder, out = prepared_data(config, workdir), workdir / "evaluation"
    rates = choose_rates(config, bundle.spec, data.Records(folder, "validation"))
    methods = {**detector_methods(bundle.spec, rates), **build_methods(config, bundle)}
    records = data.Records(folder, config.evaluation.split)
    pairs = build_pairs(bundle.spec, records)
    evaluation.write_scores(
        out / "frames.jsonl", _scores(config, bundle.spec, records, pairs, methods)
    )
    evaluation.write_tables(out / "frames.jsonl")
    shown = [
        Frame(records[int(i)], pairs[int(i)])
        for i in np.linspace(0, len(records) - 1, CLOUDS_IN_REPORT).astype(int)
    ]
    clouds = _clouds(config, shown, methods)
    evaluation.save_clouds(out / "clouds.npz", clouds)
    spec = bundle.spec
    some = [*clouds.values()][:: CLOUDS_IN_REPORT // FRAMES_IN_FIGURE]
    columns = {
        name: np.stack([data.lidar_image(frame[name], spec.fine) for frame in some])
        for name in some[0]
    }
    viz.save_figure(viz.samples_figure(columns, spec.fine), out / "samples.png")
    report = evaluation.build_report(workdir)
    table = evaluation.markdown(
        evaluation.summarise(evaluation.read_scores(out / "frames.jsonl"))
    )
    print(f"{spec.purpose}\n\n{table}\nreport: {report}")


def build_methods(config: ConfigDict, bundle: Bundle) -> dict[str, Method]:
    """The one-step estimate and the sampled cloud of a trained model."""
    params, spec = bundle

    def drawn(steps):
        @jax.jit
        def cloud(key, condition):
            image = draw_range_image(
                key,
                condition,
                diffusion.conditional_denoiser(spec.network, params, spec.noise),
                fine=spec.fine,
                noise=spec.noise,
                codec=spec.codec,
                validity_threshold=config.sampling.validity_threshold,
                steps=steps,
            )
            return unproject(image, spec.fine)

        return lambda key, frame: cloud(key, frame.pair.condition)

    steps = config.sampling.steps
    return {"one-step estimate": drawn(1), f"jradar, Heun {steps}": drawn(steps)}


def detector_methods(spec: BundleSpec, rates: dict[str, float]) -> dict[str, Method]:
    """A CFAR detector each, at its false-alarm rate, seen in the model's view."""
    return {
        f"{detector.upper()}-CFAR": functools.partial(
            _detected, spec=spec, detector=detector, rate=rate
        )
        for detector, rate in rates.items()
    }


def choose_rates(
    config: ConfigDict, spec: BundleSpec, records: data.Records
) -> dict[str, float]:
    """The false-alarm rate at which each detector has its best F-score at 0.2 m."""
    step = max(1, len(records) // config.evaluation.frames_for_rates)
    frames = [Frame(records[i], None) for i in range(0, len(records), step)]  # type: ignore
    chosen = {}
    for detector in config.evaluation.detectors:
        scores = {
            rate: np.mean([_f_score(spec, detector, rate, frame) for frame in frames])
            for rate in RATES
        }
        chosen[detector] = max(scores, key=lambda rate: scores[rate])
    return chosen


def _f_score(spec, detector, rate, frame):
    """F-score at 0.2 m of a detector on a frame; 0 where it finds nothing."""
    cloud = _detected(None, frame, spec=spec, detector=detector, rate=rate)
    xyz, truth = (
        np.asarray(cloud.xyz)[np.asarray(cloud.valid)],
        frame.prepared.lidar_xyz,
    )
    if not len(xyz) or not len(truth):
        return 0.0
    return float(compare_on_host(xyz, truth).f_score[1])


def _detected(_, frame, *, spec, detector, rate):
    """Points of a detector within the model's view."""
    cloud = _cell_cloud(frame.prepared.cells, spec.radar, detector, rate)
    seen = shared_field_of_view(
        np.asarray(cloud.xyz),
        azimuth=spec.fine.azimuth,
        elevation=spec.fine.elevation,
        max_range_m=spec.fine.max_range_m,
    )
    return cloud._replace(valid=np.asarray(cloud.valid) & seen)


@functools.partial(jax.jit, static_argnums=(1, 2, 3))
def _cell_cloud(cells, radar: RadarSpec, detector: str, rate: float) -> PointCloud:
    """Points of the cells that a detector finds."""
    guard, train = largest_window(radar.cube_shape, (2, 2), (4, 4))
    window = {"guard": guard, "train": train}
    mask = DETECTORS[detector](
        cells.power, false_alarm_rate=rate, channels=radar.num_virtual, **window
    )
    return cell_points(cells, mask, radar, **window)


def _scores(config, spec, records, pairs, methods) -> Iterator[dict[str, Any]]:
    """Scores of all sequences, one after the other."""
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    truths = {
        "LiDAR": lambda frame: PointCloud.from_xyz(frame.prepared.lidar_xyz),
        "LiDAR as an image": lambda frame: unproject(frame.pair.lidar, spec.fine),
    }
    names = list(dict.fromkeys(name for name, _ in records.where))
    every = config.evaluation.every
    index = {
        name: [i for i, (n, _) in enumerate(records.where) if n == name][::every]
        for name in names
    }
    with progress("scoring", sum(map(len, index.values())), unit="frames") as show:
        done = 0
        for name in names:
            frames = _Frames(records, pairs, index[name])
            rows = evaluation.score_frames(
                key,
                frames,
                methods,
                truths=truths,
                scene=scene_of(name),
                sequence=name,
            )
            for row in rows:
                yield row
                show(done + row["frame"] + 1, name)
            done += len(frames)


def _points(cloud):
    """The valid points of a cloud."""
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


def scene_of(name: str) -> str:
    """The scene that a sequence's scores count for."""
    try:
        return data.scene(name)
    except ValueError:
        return name.rpartition("_")[0] or name


def _clouds(config, shown, methods):
    """Clouds of some frames by scene, sequence and frame, then by method."""
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    clouds = {}
    for number, frame in enumerate(shown):
        prepared = frame.prepared
        named = {"LiDAR": prepared.lidar_xyz}
        for name, method in methods.items():
            cloud = method(jax.random.fold_in(key, number), frame)
            named[name] = _points(cloud)
        place = (scene_of(prepared.sequence), prepared.sequence, prepared.frame)
        clouds[place] = named
    return clouds


class _Frames:
    """Some frames of one sequence."""

    def __init__(self, records, pairs, index):
        self._records, self._pairs, self._index = records, pairs, index

    def __len__(self):
        return len(self._index)

    def __getitem__(self, i):
        return Frame(self._records[self._index[i]], self._pairs[self._index[i]])
