"""What a model learnt of its own answers, after its training: tables of numbers."""

from typing import NamedTuple

from jradar.model.mirror import Scaling
from jradar.range_image import IDENTITY, ConfidenceTable, TrustTable


class Tables(NamedTuple):
    """Tables that turn an answer into a confidence, and say how far to trust it."""

    confidence: ConfidenceTable = IDENTITY  # of what the network draws
    echoes: ConfidenceTable | None = None  # of points around the radar's, by crowding
    trust: TrustTable | None = None  # what conditions looked like in training
    scaling: Scaling | None = None  # of the confidence, by how much two answers differ
