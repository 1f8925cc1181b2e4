"""Fine-tuning: a model and the records of one's own rig to a model that knows them.

    FOLDER/model/             the model, for load_model(FOLDER) and --model FOLDER
    FOLDER/checkpoints/       from which a stopped run resumes
    FOLDER/metrics.jsonl      loss and validation scores; learning.png draws them
    FOLDER/replay/            simulated frames of the places that the model knew

The pixels between the beams of a sparse scan are not observed, and not learnt: they
are most of an image, for one frame of a Livox. Frames change at random in size and
direction. So that the model does not forget, a share of the change of its weights is
kept, in a mean of the weights before and after (Wortsman et al. 2022). Of these means,
that with the best F-score on the validation frames is taken, the model as it was
included. Its confidence is then fitted to the validation frames and to old ones.
"""

import dataclasses
import functools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jradar import data, diffusion, simulation, training
from jradar.data import PrepareSpec, Records
from jradar.errors import UsageError
from jradar.evaluation import (
    Frame,
    check_view,
    drawn,
    mean_scores,
    points_of,
    spread,
    with_confidence,
)
from jradar.evaluation.confidence import THRESHOLDS, judged, mean_f_scores
from jradar.fields import typed_fields
from jradar.files import lock_folder, read_json, write_text
from jradar.model import Card, Model, load_model, save_model
from jradar.range_image import (
    IDENTITY,
    TrustTable,
    close_gaps,
    condition_features,
    encode_target,
    fit_trust,
    observed_pixels,
    pattern_reach,
)
from jradar.range_image.trust import LEAST_FRAMES
from jradar.viz import learning_curve_figure, save_figure

RUN = "finetune.json"  # what is fine-tuned, and how
BEST = "best.json"  # of the evaluations so far
GAP_PIXELS = 2  # between the LiDAR's beams, closed in targets
JUDGED = 32  # validation frames of an evaluation
EVALUATIONS = 8
TRUSTED = 1200  # most frames of the table of trust
REPLAYED = "jradar-sim-5-mini"  # 8 frames of each kind, of as many radar units
OWN = data.AugmentSpec(thin=0.3, scale=(0.8, 1.25), rotation=math.radians(15))
OLD = data.AugmentSpec(
    thin=0.3, scale=(0.7, 1.5), rotation=math.radians(15), alone=0.08, perfect=0.05
)
STEPS = 100, 1, 3000  # at least, for each own frame, and at most


@dataclasses.dataclass(frozen=True)
class FinetuneSpec:
    """How a model is fine-tuned; `steps` follows from the number of frames if None."""

    steps: int | None = None
    learning_rate: float = 3e-4
    batch_size: int = 8
    kept: float = 0.75  # share of the change of the weights; 1 forgets more
    replay: float = 0.0  # share of old frames in a batch
    seed: int = 0

    def __post_init__(self):
        if self.steps is not None and self.steps < 1:
            raise ValueError(f"steps = {self.steps}, expected 1 or more")
        if not self.learning_rate > 0:
            raise ValueError(f"learning_rate = {self.learning_rate}, expected above 0")
        if self.batch_size < 1:
            raise ValueError(f"batch_size = {self.batch_size}, expected 1 or more")
        if not 0 < self.kept <= 1:
            raise ValueError(f"kept = {self.kept}, expected above 0 and at most 1")
        if not 0 <= self.replay < 1:
            raise ValueError(f"replay = {self.replay}, expected 0 to less than 1")

    def steps_for(self, frames: int) -> int:
        """Return the steps for a number of own frames."""
        least, each, most = STEPS
        return self.steps or min(least + each * frames, most)


class Finetuned(NamedTuple):
    """The model, and the scores on validation frames that chose its weights."""

    model: Model
    steps: int
    best_step: int  # 0: the model as it was
    before: dict[str, float]
    after: dict[str, float]
    frames: dict[str, int]  # of training, validation and replay

    def describe(self) -> dict[str, Any]:
        """Return what a user wants to know."""
        return {
            "frames": self.frames,
            "steps": self.steps,
            "best step": self.best_step,
            "validation before": _rounded(self.before),
            "validation after": _rounded(self.after),
            "purpose": self.model.card.purpose,
        }


def finetune(
    records: Path | str,
    folder: Path | str,
    *,
    model: Path | str = "jradar-sim",
    spec: FinetuneSpec = FinetuneSpec(),
    replay: Path | str | None = None,
) -> Finetuned:
    """Fine-tune a model on the train split of records, and write it into a folder.

    `replay` are records of old frames; by default, some are simulated. The same call
    resumes a run that was stopped. Raises UsageError for records without a training or
    a validation split, and for a folder of another run.
    """
    folder = Path(folder)
    _check_contents(folder)  # before a lock is left there
    start = load_model(model)
    own, checked = _split(records, "train"), _split(records, "validation")
    check_view(start, own)
    with lock_folder(folder):
        run = {
            "model": str(model),
            "records": own.digest,
            "validation": checked.digest,
            "replay_records": None if replay is None else str(replay),
            **dataclasses.asdict(spec),
        }
        _check_run(folder / RUN, run)
        made = simulate_replay(folder / "replay", own) if replay is None else replay
        old = Records(made, "train")
        return _trained(folder, start, own, checked, old, spec, str(model))


def _trained(folder, start, own, checked, old, spec, name):
    """Train, keep the best weights, fit the tables, and write the model."""
    steps = spec.steps_for(len(own))
    pairs, judge = _pairs(start, own), functools.partial(_judge, records=checked)
    optimizer = optax.chain(
        optax.clip_by_global_norm(1.0),
        optax.adamw(
            optax.warmup_cosine_decay_schedule(
                0.0, spec.learning_rate, min(50, steps // 4), steps
            ),
            weight_decay=1e-2,
        ),
    )
    state = training.TrainState(
        jnp.zeros((), jnp.int32),
        start.params,
        start.params,
        jax.jit(optimizer.init)(start.params),
    )
    best = folder / BEST
    if not best.exists():
        scores = judge(start)
        write_text(folder / "before.json", json.dumps(scores) + "\n")
        _keep(best, start, 0, scores)  # the last: who resumes has both

    def evaluate(state, step):
        params = _between(start.params, jax.device_get(state.ema_params), spec.kept)
        found = dataclasses.replace(start, params=params)
        scores = judge(found)
        if scores["f_score_0.2"] > read_json(best)["scores"]["f_score_0.2"]:
            _keep(best, found, step, scores)
        return scores

    training.train(
        jax.random.fold_in(jax.random.key(spec.seed), 0),
        state,
        training.make_train_step(
            start.spec.network,
            optimizer,
            start.spec.noise,
            loss=LOSSES[start.spec.method],
            ema_decay=min(0.995, 1 - 10 / steps),
        ),
        _batches(start, own, old, spec),
        steps=steps,
        workdir=folder,
        data_digest=own.digest,
        checkpoint_every=max(steps // 10, 10),
        evaluate_every=max(steps // EVALUATIONS, 1),
        evaluate=evaluate,
    )
    kept = read_json(best)
    found = load_model(folder / "best")
    found = dataclasses.replace(
        found,
        card=_card(start.card, own, old, kept["step"], name),
        trust=trust_of(pairs, _pairs(start, old)) or start.trust,
    )
    key = jax.random.fold_in(jax.random.key(spec.seed), 1)
    # The frames of one place alone would make every point look as sure as there.
    found = with_confidence(key, found, checked, old)
    save_model(folder / "model", found)
    training.write_model_card(
        folder,
        config={"finetune": dataclasses.asdict(spec), "model": name},
        data_digest=own.digest,
        seed=spec.seed,
        steps=steps,
        purpose=found.card.purpose,
    )
    curve = learning_curve_figure(folder / "metrics.jsonl")
    save_figure(curve, folder / "learning.png")
    counts = {"training": len(own), "validation": len(checked)}
    counts["replay"] = len(old)
    before = read_json(folder / "before.json")
    return Finetuned(found, steps, kept["step"], before, kept["scores"], counts)


def _between(before: Any, after: Any, share: float) -> Any:
    """Return parameters at a share of the way from those before to those after."""
    return jax.tree.map(
        lambda a, b: np.asarray(a) + np.float32(share) * (np.asarray(b) - a),
        before,
        after,
    )


def _split(records: Path | str, split: str) -> Records:
    """Return a split of records, or say how to get it."""
    try:
        return Records(records, split)
    except ValueError as error:
        if "has no sequences of split" not in str(error):
            raise
        names = ", ".join(s["name"] for s in Records(records).sequences)
        option = "" if split == "train" else f" with --{split} NAME"
        raise UsageError(
            f"{records} has no {split} frames: prepare several recordings again"
            f"{option}, so that some train and others validate; it holds {names}"
        ) from error


def _check_contents(folder: Path) -> None:
    """Raise UsageError for a folder with other contents than those of a run."""
    others = sorted(path.name for path in folder.glob("[!.]*"))
    if others and not (folder / RUN).is_file():
        raise UsageError(
            f"{folder} holds {others[0]}, which is not of a fine-tuning: choose "
            "another output"
        )


def _check_run(path: Path, run: dict[str, Any]) -> None:
    """Record what a run is; UsageError for the folder of another one."""
    if not path.exists():
        write_text(path, json.dumps(run, indent=2) + "\n")
        return
    found = read_json(path)
    for key in run:
        if found.get(key) != run[key]:
            raise UsageError(
                f"{path.parent} holds a run with {key} = {found.get(key)}, now "
                f"{run[key]}: choose another output"
            )


def simulate_replay(folder: Path | str, own: Records) -> Path:
    """Return records of simulated places, prepared as one's own; made once."""
    records = Path(folder) / "records"
    try:
        return Records(records, "train").folder
    except (FileNotFoundError, ValueError):
        pass
    places = [s for s in simulation.drawn_sources(REPLAYED) if s.split == "train"]
    options = typed_fields(PrepareSpec, own.manifest["options"])
    data.prepare_sources(places, records, PrepareSpec(**options), workers=2)
    return records


def _pairs(model: Model, records: Records) -> data.PairSource:
    spec = model.spec
    return data.PairSource(records, spec.coarse, spec.fine, num_slices=spec.num_slices)


def _batches(model, own, old, spec) -> Callable[[int], training.Batch]:
    """Return the function from a step to a batch of own and old frames."""
    share = min(round(spec.batch_size * spec.replay), spec.batch_size - 1)
    sources = (own, spec.batch_size - share, OWN), (old, share, OLD)
    parts = [_part(model, *source, spec.seed) for source in sources if source[1]]

    def batch_at(step):
        found = [part(step) for part in parts]
        return jax.tree.map(lambda *values: jnp.concatenate(values), *found)

    return batch_at


def _part(model, records, count, change, seed) -> Callable[[int], training.Batch]:
    """Return the function from a step to so many frames of these records.

    Where the beams are too far apart for `close_gaps`, empty pixels near a hit are not
    learnt.
    """
    spec = model.spec
    low, high = spec.fine.azimuth
    change = dataclasses.replace(change, mirror=low == -high)
    grids = spec.coarse, spec.fine, spec.num_slices
    batches = data.Batches(
        records,
        seed=seed,
        batch_size=count,
        change=data.AugmentedPairs(*grids, change),
    )
    pairs = _pairs(model, records)
    reach = pattern_reach(
        np.stack([pairs[i].lidar for i in spread(len(pairs), JUDGED)])
    )

    def batch_at(step):
        batch = batches[step]
        closed = close_gaps(batch.lidar, reach=GAP_PIXELS)
        target = encode_target(closed, spec.fine, codec=spec.codec)
        if reach > GAP_PIXELS:
            observed = observed_pixels(closed, reach=reach)[..., None]
            target = target.at[..., 1:].multiply(observed)
        return training.Batch(jnp.asarray(batch.condition), target)

    return batch_at


def _judge(model: Model, records: Records) -> dict[str, float]:
    """Return the mean scores of the model's answer to some validation frames.

    A model with confidence is judged at the least confidence that is best for it, as
    its table is fitted only later.
    """
    key = jax.random.key(0)
    plain = dataclasses.replace(model, confidence=IDENTITY)
    if found := [*judged(key, plain, records, frames=JUDGED)]:
        least = THRESHOLDS[int(np.argmax(mean_f_scores(found)))]
        clouds = [frame.xyz[frame.confidence >= least] for frame in found]
        return mean_scores(clouds, [frame.truth for frame in found])
    pairs = _pairs(model, records)
    method, index = drawn(model), spread(len(records), JUDGED)
    frames = {i: Frame(records[i], pairs[i]) for i in index}
    clouds = [method(jax.random.fold_in(key, i), f) for i, f in frames.items()]
    truths = [frame.prepared.lidar_xyz for frame in frames.values()]
    return mean_scores(map(points_of, clouds), truths)


def _keep(path: Path, model: Model, step: int, scores: dict[str, float]) -> None:
    """Write the weights that are the best so far, and then their scores."""
    save_model(path.parent / "best", model, dtype=np.float32)
    write_text(path, json.dumps({"step": step, "scores": scores}) + "\n")


def trust_of(*sources: data.PairSource) -> TrustTable | None:
    """Return what conditions look like in training; None for too few frames."""
    features = [
        np.asarray(condition_features(pairs[i].condition))
        for pairs in sources
        for i in spread(len(pairs), TRUSTED)
    ]
    return fit_trust(np.stack(features)) if len(features) >= LEAST_FRAMES else None


def _card(card: Card, own: Records, old: Records, step: int, name: str) -> Card:
    if not step:
        return card
    radars = dict.fromkeys((own.radar, *own.other_radars, *card.radars))
    fitted = f", confidence fitted to {len(old)} old ones, too"
    return Card(
        purpose=f"{name} fine-tuned on {len(own)} frames of one's own rig",
        steps_seen=card.steps_seen + step,
        trained_on=f"{len(own)} own frames {own.digest[:12]}{fitted}",
        radars=tuple(radars),
    )


def _rounded(scores: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in scores.items()}


LOSSES: dict[str, Callable[..., jax.Array]] = {  # with the weights of shipped models
    "diffusion": diffusion.where_known(
        diffusion.denoising_loss, weights=diffusion.LossSpec(range_weight=4.0)
    ),
    "regression": diffusion.where_known(diffusion.regression_loss, range_weight=4.0),
    "marginal": diffusion.mixture_loss,
}
