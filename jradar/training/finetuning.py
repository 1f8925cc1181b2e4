"""Fine-tuning: a model and the records of one's own rig to a model that knows them.

A quarter of each batch is old frames (replay). Each evaluation scores the weights on
the validation frames; the best ones are kept, or the model as it was. If they lose more
than `forget` points on old frames that were not replayed, they are averaged with the
initial weights (Wortsman et al. 2022). The confidence is then fitted to the validation
frames and to those old ones.

    FOLDER/model/             the model, for load_model(FOLDER) and --model FOLDER
    FOLDER/checkpoints/       from which a stopped run resumes
    FOLDER/metrics.jsonl      loss and validation scores; learning.png draws them
    FOLDER/replay/            simulated frames of the places that the model knew
"""

import dataclasses
import json
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar.data import Records, pairs_of
from jradar.diffusion.network import network_fields, network_from_fields
from jradar.errors import UsageError
from jradar.evaluation import check_view, trust_of, with_confidence
from jradar.fields import typed_fields
from jradar.files import lock_folder, read_json, write_text
from jradar.lidar import LidarSpec
from jradar.model import Card, Model, load_model, save_model
from jradar.range_image import VIEW
from jradar.recordings import Stream
from jradar.training.choosing import (
    SCORE,
    Kept,
    Scores,
    both_scores,
    frame_scores,
    kept_change,
)
from jradar.training.logs import write_model_card
from jradar.training.loop import train
from jradar.training.losses import LOSSES
from jradar.training.optimiser import clipped_adamw
from jradar.training.replay import Old, batches_of, halves, simulate_replay
from jradar.training.step import make_train_step, state_of
from jradar.viz import learning_curve_figure, save_figure

RUN = "finetune.json"  # what is fine-tuned, and how
BEST = "best.json"  # of the evaluations so far
BEFORE = "before.json"  # scores of the model as it was
EVALUATIONS = 8
NOTHING = Stream([].__getitem__, 0)
STEPS = 100, 1, 3000  # at least, for each own frame, and at most


@dataclasses.dataclass(frozen=True)
class FinetuneSpec:
    """How a model is fine-tuned; `steps` follows from the number of frames if None."""

    steps: int | None = None
    learning_rate: float = 3e-4
    batch_size: int = 8
    replay: float = 0.25  # share of old frames in a batch
    forget: float = 1.0  # most points of the F-score that old frames may lose
    own_view: bool = False  # take that of the records, without old frames
    seed: int = 0

    def __post_init__(self):
        if self.steps is not None and self.steps < 1:
            raise ValueError(f"steps = {self.steps}, expected 1 or more")
        if not self.learning_rate > 0:
            raise ValueError(f"learning_rate = {self.learning_rate}, expected above 0")
        if self.batch_size < 1:
            raise ValueError(f"batch_size = {self.batch_size}, expected 1 or more")
        if not 0 <= self.replay < 1:
            raise ValueError(f"replay = {self.replay}, expected 0 to less than 1")
        if not self.forget >= 0:
            raise ValueError(f"forget = {self.forget}, expected 0 points or more")

    def steps_for(self, frames: int) -> int:
        """Return the steps for a number of own frames."""
        least, each, most = STEPS
        return self.steps or min(least + each * frames, most)


class Finetuned(NamedTuple):
    """The model, and the scores that chose its weights."""

    model: Model
    steps: int
    best_step: int  # 0: the model as it was
    share: float  # of the change of the weights that is kept
    before: Scores
    after: Scores
    frames: dict[str, int]

    def describe(self) -> dict[str, Any]:
        """Return frames, steps and scores, as tables."""
        found = {
            "frames": self.frames,
            "steps": self.steps,
            "best step": self.best_step,
            "share of the change kept": self.share,
            "validation before": _rounded(self.before.own),
            "validation after": _rounded(self.after.own),
        } | (
            {
                "old places before": _rounded(self.before.old),
                "old places after": _rounded(self.after.old),
            }
            if self.frames["old"]
            else {}
        )
        return found | {"purpose": self.model.card.purpose}


def finetune(
    records: Path | str,
    folder: Path | str,
    *,
    model: Path | str = "jradar-sim",
    spec: FinetuneSpec = FinetuneSpec(),
    replay: Path | str | None = None,
) -> Finetuned:
    """Fine-tune a model on the train split of records, and write it into a folder.

    With `own_view`, the model takes the field of view of the records. What it knows of
    12 m, it then knows of their largest range. It leaves the old places behind, so that
    no old frames are replayed.

    `replay` are records of old frames; those of every other sequence are held out. By
    default, two processes simulate some, so that a script calls this under
    `if __name__ == "__main__":`. The same call resumes a run that was stopped. Raises
    UsageError for records without a training or a validation split, and for a folder
    of another run.
    """
    folder = Path(folder)
    _check_contents(folder)  # before a lock is left there
    start = load_model(model)
    pairs_of(start.spec, [])  # refuses a model that sees no points
    if spec.own_view and replay is not None:
        raise UsageError(f"{replay=}: a model in its own view replays no old frames")
    own, checked = _split(records, "train"), _split(records, "validation")
    if spec.own_view:
        start = in_view_of(start, own)
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
        old = Old(NOTHING, NOTHING)
        if not spec.own_view:
            steps = spec.steps_for(len(own))
            replay = replay or simulate_replay(folder / "replay", own, steps=steps)
            old = halves(Records(replay, "train"))
        return _trained(folder, start, own, checked, old, spec, str(model))


def in_view_of(model: Model, records: Records) -> Model:
    """Return the model with the field of view of records; its weights stay."""
    lidar = typed_fields(LidarSpec, records.manifest["options"]["lidar"])
    view = {name: lidar[name] for name in VIEW}
    grid: Any = model.spec.grid
    coarse, fine = (
        dataclasses.replace(image, **view) for image in (grid.coarse, grid.fine)
    )
    fields = network_fields(model.spec.network)
    seen = {name: value for name, value in view.items() if name in fields}
    spec = dataclasses.replace(
        model.spec,
        grid=dataclasses.replace(grid, coarse=coarse, fine=fine),
        network=network_from_fields(fields | seen),
    )
    return dataclasses.replace(model, spec=spec)


def _trained(folder, start, own, checked, old, spec, name):
    """Train, keep the best weights, fit the tables, and write the model."""
    steps = spec.steps_for(len(own))
    best = folder / BEST
    if not best.exists():
        scores = both_scores(start, checked, old)
        write_text(folder / BEFORE, json.dumps(scores._asdict()) + "\n")
        _keep(best, start, 0, scores.own)  # last: a run that resumes finds both
    _train(folder, start, own, checked, old, spec)
    before = Scores(**read_json(folder / BEFORE))
    kept, step = Kept(start, 0.0, before), read_json(best)["step"]
    if step:
        tuned = load_model(folder / "best").params
        limits = {"before": before, "forget": spec.forget}
        kept = kept_change(start, tuned, checked, old, **limits)
    card = _card(start.card, own, old, step, name) if kept.share else start.card
    pairs = [pairs_of(start.spec, frames) for frames in (own, *old)]
    trust = trust_of(start.spec.frame_grid, *pairs) or start.tables.trust
    found = dataclasses.replace(kept.model, card=card).with_tables(trust=trust)
    key = jax.random.fold_in(jax.random.key(spec.seed), 1)
    # Fitted to one place alone, points elsewhere would seem as sure as there.
    known = [frames for frames in (checked, old.checked) if len(frames)]
    found = with_confidence(key, found, *known)
    save_model(folder / "model", found)
    write_model_card(
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
    counts |= {"old": len(old.replayed), "old, held out": len(old.checked)}
    return Finetuned(found, steps, step, kept.share, before, kept.scores, counts)


def _train(folder, start, own, checked, old, spec):
    """Train, and keep the weights with the best score on the validation frames."""
    steps, best = spec.steps_for(len(own)), folder / BEST
    optimizer = clipped_adamw(
        steps=steps, learning_rate=spec.learning_rate, warmup_steps=min(50, steps // 4)
    )

    def evaluate(state, step):
        params = jax.device_get(state.ema_params)
        found = dataclasses.replace(start, params=params)
        scores = frame_scores(found, checked)
        if scores[SCORE] > read_json(best)["scores"][SCORE]:
            _keep(best, found, step, scores)
        return scores

    train(
        jax.random.fold_in(jax.random.key(spec.seed), 0),
        state_of(start.params, optimizer),
        make_train_step(
            start.spec.network,
            optimizer,
            start.spec.noise,
            loss=LOSSES["view"][start.spec.method],
            ema_decay=min(0.995, 1 - 10 / steps),
        ),
        batches_of(
            start,
            own,
            old.replayed,
            batch_size=spec.batch_size,
            replay=spec.replay if len(old.replayed) else 0.0,
            seed=spec.seed,
        ),
        steps=steps,
        workdir=folder,
        data_digest=own.digest,
        checkpoint_every=max(steps // 10, 10),
        evaluate_every=max(steps // EVALUATIONS, 1),
        evaluate=evaluate,
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
    """Raise UsageError for a folder that holds anything but a run."""
    others = sorted(path.name for path in folder.glob("[!.]*"))
    if others and not (folder / RUN).is_file():
        raise UsageError(
            f"{folder} holds {others[0]}, which fine-tuning did not write: choose "
            "another output"
        )


def _check_run(path: Path, run: dict[str, Any]) -> None:
    """Record the run in its folder; UsageError for the folder of another one."""
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


def _keep(path: Path, model: Model, step: int, scores: dict[str, float]) -> None:
    """Write the weights that are the best so far, and then their scores."""
    save_model(path.parent / "best", model, dtype=np.float32)
    write_text(path, json.dumps({"step": step, "scores": scores}) + "\n")


def _card(card: Card, own: Records, old: Old, step: int, name: str) -> Card:
    recorded = () if own.of_points else (own.radar, *own.other_radars)
    radars = dict.fromkeys((*recorded, *card.radars))
    return Card(
        purpose=f"{name} fine-tuned on {len(own)} frames of one's own rig",
        steps_seen=card.steps_seen + step,
        trained_on=f"{len(own)} own frames {own.digest[:12]}, with "
        f"{len(old.replayed)} old ones",
        radars=tuple(radars),
        sent_points=card.sent_points or own.of_points,
    )


def _rounded(scores: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in scores.items()}
