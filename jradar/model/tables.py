"""Tables of what is known about a model's answers, fitted after its training."""

from typing import NamedTuple

from jradar.model.mirror import Scaling
from jradar.range_image import IDENTITY, ConfidenceTable, TrustTable


class Tables(NamedTuple):
    """Tables that turn an answer into a confidence, and say how far to trust it."""

    confidence: ConfidenceTable = IDENTITY  # of what the network draws
    echoes: ConfidenceTable | None = None  # of points around the radar's, by crowding
    trust: TrustTable | None = None  # what conditions looked like in training
    scaling: Scaling | None = None  # of the confidence, by the mirror's disagreement
