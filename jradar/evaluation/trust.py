"""What conditions look like in training, so that unusual ones are recognised."""

import numpy as np

from jradar.data import PairSource
from jradar.evaluation.statistics import spread
from jradar.range_image import TrustTable, condition_features, fit_trust
from jradar.range_image.trust import LEAST_FRAMES

TRUSTED = 1200  # most frames of each source


def trust_of(*sources: PairSource) -> TrustTable | None:
    """Return the table of trust of the sources' conditions; None for too few."""
    features = [
        np.asarray(condition_features(pairs[i].condition))
        for pairs in sources
        for i in spread(len(pairs), TRUSTED)
    ]
    return fit_trust(np.stack(features)) if len(features) >= LEAST_FRAMES else None
