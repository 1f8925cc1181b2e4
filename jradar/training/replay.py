"""One's own frames and old ones to batches; the old ones are simulated.

Frames change at random in size and direction. Pixels between the beams of a sparse scan
were not observed, and are not learnt. For one frame of a Livox, they are most of an
image.
"""

import dataclasses
import logging
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from jradar import data, simulation
from jradar.data import Batch, PreparedFrame, PrepareSpec, Records, pairs_of
from jradar.evaluation import spread
from jradar.fields import typed_fields
from jradar.model import Model, ViewGrid
from jradar.range_image import pattern_reach
from jradar.recordings.recording import Stream
from jradar.training.targets import pair_batches

PATTERN = 32  # frames that show the pattern of the beams
REPLAYED, UNITS = "jradar-sim-5", 8  # radar units of each kind
OF_A_UNIT = slice(0, 1)  # of its eight frames
LOG = logging.getLogger(__name__)
OLD_PLACES = (
    "first, %d frames of old places are simulated, so that the model does not forget "
    "them: about %.0f minutes on two cores, of %.0f in all with %d steps of training "
    "and the scores. They are kept in %s. --replay-records FOLDER takes frames that "
    "you have instead"
)
OLD_MIN, STEP_MIN, SCORES_MIN = 1 / 60, 1.3 / 60, 2.0  # a frame, a step, all scores
OWN = data.AugmentSpec(thin=0.3, scale=(0.8, 1.25), rotation=math.radians(15))
OLD = data.AugmentSpec(
    thin=0.3, scale=(0.7, 1.5), rotation=math.radians(15), alone=0.08, perfect=0.05
)


def simulate_replay(folder: Path | str, own: Records, *, steps: int) -> Path:
    """Return records of simulated places, prepared as one's own; made once.

    What is logged before names the time until the model is trained, for `steps`.
    """
    records = Path(folder) / "records"
    try:
        return Records(records, "train").folder
    except (FileNotFoundError, ValueError):
        pass
    drawn = simulation.drawn_sources(REPLAYED)
    places = [s for s in drawn if s.split == "train" and s.number < UNITS]
    first = OLD_MIN * len(places)
    total = first + STEP_MIN * steps + SCORES_MIN
    LOG.warning(OLD_PLACES, len(places), math.ceil(first), total, steps, folder)
    spec = PrepareSpec(**typed_fields(PrepareSpec, own.manifest["options"]))
    data.prepare_sources(places, records, spec, frames=OF_A_UNIT, workers=2)
    return records


class Old(NamedTuple):
    """Frames of the places that the model knew."""

    replayed: Stream
    checked: Stream  # held out


def halves(records: Records) -> Old:
    """Return the frames of every other sequence, and those of the others.

    Radar units are held out with their places. The only sequence is in both halves.
    """
    order = {s["name"]: k for k, s in enumerate(records.sequences)}
    index: tuple[list[int], list[int]] = ([], [])
    for i, (name, _) in enumerate(records.where):
        index[order[name] % 2].append(i)
    even, odd = index
    return Old(*(_subset(records, some) for some in (even, odd or even)))


def _subset(records: Records, index: list[int]) -> Stream:
    return Stream(lambda k: records[index[k]], len(index))


def batches_of(
    model: Model,
    own: Sequence[PreparedFrame],
    old: Sequence[PreparedFrame],
    *,
    batch_size: int,
    replay: float,
    seed: int,
) -> Callable[[int], Batch]:
    """Return the function from a step to a batch; `replay` is the share of old frames.

    At least one frame of each batch is one's own.
    """
    share = min(round(batch_size * replay), batch_size - 1)
    sources = (own, batch_size - share, OWN), (old, share, OLD)
    parts = [_part(model, *source, seed) for source in sources if source[1]]

    def batch_at(step: int) -> Batch:
        found = [part(step) for part in parts]
        return jax.tree.map(lambda *values: np.concatenate(values), *found)

    return batch_at


def _part(model, frames, count, change, seed) -> Callable[[int], Batch]:
    """Return the function from a step to so many of these frames.

    Where the beams are too far apart for `close_gaps`, empty pixels near a hit are not
    learnt.
    """
    grid: ViewGrid = model.spec.grid
    low, high = grid.fine.azimuth
    pairs = pairs_of(model.spec, frames)
    shown = [pairs[i].lidar for i in spread(len(pairs), PATTERN)]
    return pair_batches(
        frames,
        grid,
        dataclasses.replace(change, mirror=low == -high),
        batch_size=count,
        seed=seed,
        reach=pattern_reach(np.stack(shown)),
    )
