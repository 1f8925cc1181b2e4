"""What conditions look like in training, so that unusual ones are recognised."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jradar.evaluation.statistics import spread
from jradar.model import FrameGrid
from jradar.range_image import TrustTable, fit_trust
from jradar.range_image.trust import LEAST_FRAMES

TRUSTED = 1200  # most frames of each source


def trust_of(
    grid: FrameGrid, *sources: Sequence[Any], most: int = TRUSTED
) -> TrustTable | None:
    """Return the table of trust of a grid's conditions; None for too few frames.

    The items of `sources` have a `condition`. At most `most` of each are described.
    """
    described = jax.jit(grid.features)
    features = [
        np.asarray(described(pairs[i].condition))
        for pairs in sources
        for i in spread(len(pairs), most)
    ]
    return fit_trust(np.stack(features)) if len(features) >= LEAST_FRAMES else None
