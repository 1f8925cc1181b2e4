"""The task `rpdnet`: train RPDNet on records, and score its row.

The network takes the place of a CFAR detector: the points of its cells are found as
theirs are. What corresponds to their false-alarm rate, the probability from which on a
cell counts, is chosen on the validation split in the same way. Detector and critic are
one state of the training loop, so that a run goes on where it was stopped.
"""

import functools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from ml_collections import ConfigDict

from experiments.build import (
    INIT_KEY,
    SAMPLE_KEY,
    TRAIN_KEY,
    build_optimizer,
    check_workdir,
    prepared_data,
)
from experiments.evaluate import write_results
from experiments.studies.detectors import (
    View,
    f_score,
    points_of,
    seen_points,
    view_of,
)
from experiments.tasks.radarhd import load_weights, save_weights
from jradar import data, training
from jradar.baselines import (
    RPDNet,
    label_cells,
    map_values,
    rpdnet_loss,
    rpdnet_params,
    sensor_velocities,
)
from jradar.metrics import compare_on_host
from jradar.types import PointCloud

LIMITS = (0.05, 0.15, 0.25, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the probability
Probability = Callable[[np.ndarray], np.ndarray]  # of each cell, from a map of power


class LabelledMaps(Sequence):
    """Maps of power and their labels `[doppler, range, 1]`, as a batch stacks them."""

    def __init__(self, records: data.Records, *, min_snr_db: float):
        """Frames whose velocity is known from the poses around them."""
        self._records, self._min_snr_db = records, min_snr_db
        velocities = record_velocities(records)
        self._index = np.flatnonzero(np.isfinite(velocities).all(-1)).tolist()
        self._velocities = velocities[self._index]
        if not self._index:
            raise ValueError(
                f"{records.folder} has no frame whose velocity is known: labels need "
                "recordings with a trajectory"
            )

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, i: Any) -> Any:
        """Item `i`, as `training.Batch` has it."""
        frame = self._records[self._index[i]]
        label = label_cells(
            frame.lidar_xyz,
            self._velocities[i],
            frame.cells.power,
            self._records.radar,
            min_snr_db=self._min_snr_db,
            range_bias_m=frame.range_bias_m,
        )
        values = map_values(frame.cells.power)
        return training.Batch(values[..., None], label[..., None].astype(np.float32))


def record_velocities(records: data.Records) -> np.ndarray:
    """The radar's own velocity at each record, `[frame, 3]`; NaN where unknown."""
    stamps, poses = np.zeros(len(records)), np.zeros((len(records), 4, 4))
    for i in range(len(records)):
        frame = records[i]
        stamps[i], poses[i] = frame.stamp, frame.world_from_radar
    names = np.array([name for name, _ in records.where])
    velocities = np.full((len(records), 3), np.nan)
    for name in dict.fromkeys(names):
        mine = names == name
        velocities[mine] = sensor_velocities(stamps[mine], poses[mine])
    return velocities


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the weights, evaluate. Resumes where the workdir stands."""
    check_workdir(config, workdir)
    folder = prepared_data(config, workdir)
    records = data.Records(folder, "train")
    items = LabelledMaps(records, min_snr_db=config.data.min_snr_db)
    print(f"{len(items)} training frames", file=sys.stderr, flush=True)
    batches = data.Batches(items, seed=config.seed, batch_size=config.train.batch_size)
    detector = build_detector(config)
    optimizer = build_optimizer(config.train)
    params = rpdnet_params(
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        detector,
        items[0].condition.shape[:2],
    )
    state = training.TrainState(
        jnp.zeros((), jnp.int32), params, params, optimizer.init(params)
    )
    checked = data.Records(folder, "validation")
    state = training.train(
        jax.random.fold_in(jax.random.key(config.seed), TRAIN_KEY),
        state,
        make_step(detector, optimizer, config.train),
        lambda step: training.Batch(*batches[step]),
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
        evaluate_every=config.train.evaluate_every,
        evaluate=lambda state, _: validate(config, state.ema_params, checked),
        best="chamfer",
    )
    if jax.process_index():
        return
    save_weights(workdir / "weights.safetensors", state.ema_params["detector"])
    training.write_model_card(
        workdir,
        config=config.to_dict(),
        data_digest=records.digest,
        seed=config.seed,
        steps=config.train.steps,
        purpose=config.purpose,
    )
    run_evaluation(config, workdir)


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's weights on the config's split; tables and report."""
    params = load_weights(workdir / "weights.safetensors")
    folder = prepared_data(config, workdir)
    records = data.Records(folder, config.evaluation.split)
    view, probability = view_of(records), cell_probability(config, params)
    limit, _ = choose_limit(
        view,
        probability,
        data.Records(folder, "validation"),
        frames=config.evaluation.frames_for_limit,
    )
    print(f"cells of probability {limit} and more")
    write_results(
        jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY),
        workdir,
        view,
        records,
        data.PairSource(records, view.fine, view.fine, num_slices=1),
        {
            "RPDNet": lambda _, frame: marked_points(
                frame.prepared, view, probability, limit
            )
        },
        every=config.evaluation.every,
    )


def build_detector(config: ConfigDict) -> RPDNet:
    """The network that is kept; its critic has one form only."""
    return RPDNet(**config.network)


def make_step(
    detector: RPDNet, optimizer: optax.GradientTransformation, train: ConfigDict
) -> Callable[..., Any]:
    """The jitted step `(state, key, batch) -> (state, metrics)`; it draws nothing."""
    weight, decay = train.adversarial, train.ema_decay

    @jax.jit
    def step(state, key, batch):
        (value, parts), gradient = jax.value_and_grad(
            functools.partial(rpdnet_loss, detector, weight=weight), has_aux=True
        )(state.params, batch.condition, batch.target)
        updates, opt_state = optimizer.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        share = 1 - training.ema_decay_at(state.step, decay=decay)
        averaged = optax.incremental_update(params, state.ema_params, share)
        metrics = {"loss": value, "gradient_norm": optax.tree.norm(gradient), **parts}
        return training.TrainState(state.step + 1, params, averaged, opt_state), metrics

    return step


def cell_probability(config: ConfigDict, params: Any) -> Probability:
    """A function from a map of power to the probability of each of its cells."""
    logits = jax.jit(build_detector(config).apply)

    def probability(power):
        maps = map_values(np.asarray(power))[None, ..., None]
        found: Any = logits(params, maps)
        return np.asarray(jax.nn.sigmoid(found))[0, ..., 0]

    return probability


def marked_points(
    prepared: data.PreparedFrame, view: View, probability: Probability, limit: float
) -> PointCloud:
    """Points of the cells whose probability is at least `limit`."""
    power = np.asarray(prepared.cells.power)
    return seen_points(prepared, probability(power) >= limit, view)


def choose_limit(
    view: View, probability: Probability, records: data.Records, *, frames: int
) -> tuple[float, float]:
    """The limit with the best mean F-score at 0.2 m, and that score."""
    index = np.linspace(0, len(records) - 1, min(frames, len(records))).astype(int)
    prepared = [records[int(i)] for i in index]
    found = [probability(frame.cells.power) for frame in prepared]

    def mean_score(limit):
        scores = [
            f_score(seen_points(frame, cells >= limit, view), frame)
            for frame, cells in zip(prepared, found, strict=True)
        ]
        return float(np.mean(scores))

    scores = {limit: mean_score(limit) for limit in LIMITS}
    best = max(scores, key=lambda limit: scores[limit])
    return best, scores[best]


def validate(
    config: ConfigDict, params: Any, records: data.Records
) -> dict[str, float]:
    """Scores on some validation frames, at the limit that suits these best."""
    view = view_of(records)
    probability = cell_probability(config, params["detector"])
    count = config.evaluation.frames_while_training
    limit, score = choose_limit(view, probability, records, frames=count)
    chamfer = []
    for i in np.linspace(0, len(records) - 1, min(count, len(records))).astype(int):
        frame = records[int(i)]
        xyz = points_of(marked_points(frame, view, probability, limit))
        chamfer.append(compare_on_host(xyz, frame.lidar_xyz).chamfer)
    nothing = 2 * view.fine.max_range_m  # the Chamfer distance where there is no cloud
    return {
        "chamfer": float(np.nan_to_num(np.array(chamfer), nan=nothing).mean()),
        "f_score_0.2": score,
        "limit": limit,
    }
