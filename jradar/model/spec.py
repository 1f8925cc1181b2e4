"""What a model is: parameters, what shapes the computation, tables, and a card."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar.diffusion import Network, NoiseSpec
from jradar.model.methods import METHODS
from jradar.radar import PointSpec, RadarSpec
from jradar.range_code import CODECS
from jradar.range_image import IDENTITY, ConfidenceTable, ImageSpec, TrustTable


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """What shapes a model's computation; `method` is how its network answers."""

    method: str
    network: Network
    noise: NoiseSpec
    coarse: ImageSpec  # of the condition
    fine: ImageSpec  # of the result
    points: PointSpec
    num_slices: int
    codec: str
    validity_threshold: float = 0.0
    temperature: float = 1.0  # of a single draw

    def __post_init__(self):
        """Refuse an unknown method or codec, and a temperature below 0."""
        for field, known in (("method", METHODS), ("codec", CODECS)):
            if (value := getattr(self, field)) not in known:
                raise ValueError(f"{field} = {value!r}, expected one of {[*known]}")
        if not 0 <= self.temperature < math.inf:
            raise ValueError(f"temperature = {self.temperature}, expected 0 or more")


@dataclasses.dataclass(frozen=True)
class Card:
    """Where a model comes from. `purpose` is shown to users of the weights."""

    purpose: str = ""
    steps_seen: int = 0
    trained_on: str = ""
    radars: tuple[RadarSpec, ...] = ()  # of training; the first recorded the most

    @property
    def radar(self) -> RadarSpec:
        """The radar that recorded most of the training frames.

        Raises ValueError for a card without radars.
        """
        if not self.radars:
            raise ValueError(
                "the model's card names no radar, expected those of training: "
                "Card(radars=(RadarSpec.awr1843(),))"
            )
        return self.radars[0]


@jax.tree_util.register_pytree_with_keys_class
@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class Model:
    """A trained network: a pytree whose leaves are the parameters and the tables.

    `spec` is static. The `card` changes no computation, so it is in neither: models
    that differ in their cards alone share compiled programs, and go together through
    `jax.tree.map`, which keeps the card of the first.
    """

    params: Any
    spec: ModelSpec
    card: Card = Card()
    confidence: ConfidenceTable = IDENTITY
    trust: TrustTable | None = None  # what conditions looked like in training
    echoes: ConfidenceTable | None = None  # of points around the radar's, by `crowding`

    def tree_flatten_with_keys(self) -> tuple[Iterable[tuple[Any, Any]], Any]:
        """The parts that are arrays, and the static ones."""
        names = ("params", "confidence", "trust", "echoes")
        leaves = [(jax.tree_util.GetAttrKey(n), getattr(self, n)) for n in names]
        return leaves, (self.spec, _Passenger(self.card))

    @classmethod
    def tree_unflatten(cls, static: Any, leaves: Iterable[Any]) -> "Model":
        """The model of parts that `tree_flatten_with_keys` returned."""
        params, *tables = leaves
        spec, passenger = static
        return cls(params, spec, passenger.card, *tables)

    def __repr__(self) -> str:
        """One line: method, size, view, and what it was trained on."""
        leaves = jax.tree.leaves(self.params)
        size = sum(int(np.prod(np.shape(leaf))) for leaf in leaves) / 1e6
        fine = self.spec.fine
        return (
            f"Model({self.spec.method}, {size:.3g} million parameters, {fine.height} x "
            f"{fine.width} pixels to {fine.max_range_m:g} m, {self.card.steps_seen:,} "
            f"steps on {self.card.trained_on or 'unknown data'})"
        )


class _Passenger(NamedTuple):
    """A card within a pytree's structure, which all cards leave the same."""

    card: Card

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Passenger)

    def __hash__(self) -> int:
        return hash(_Passenger)
