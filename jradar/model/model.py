"""What a model is: parameters, a static spec of the computation, tables, and a card."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar.diffusion import Network, NoiseSpec
from jradar.model.grids import FrameGrid, Grid
from jradar.model.tables import Tables
from jradar.radar import PointSpec, RadarSpec


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """What shapes a model's computation; `method` is how its network answers."""

    method: str
    network: Network
    noise: NoiseSpec
    grid: Grid
    points: PointSpec = PointSpec()  # of the radar, in training
    temperature: float = 1.0  # of a single draw

    def __post_init__(self):
        """Refuse a method that the grid lacks, and a temperature below 0."""
        if self.method not in self.grid.methods:
            raise ValueError(
                f"method = {self.method!r}, expected one of {[*self.grid.methods]}"
            )
        if not 0 <= self.temperature < math.inf:
            raise ValueError(f"temperature = {self.temperature}, expected 0 or more")

    @property
    def frame_grid(self) -> FrameGrid:
        """The grid of a model of frames. Raises ValueError for one of maps."""
        if not isinstance(self.grid, FrameGrid):
            raise ValueError(
                "this model completes maps, expected one of a radar's frames, such as "
                "jradar-sim: use `jradar map`, or `jradar.mapping.enhance_map`"
            )
        return self.grid


@dataclasses.dataclass(frozen=True)
class Card:
    """Where a model comes from. `purpose` is shown to users of the weights."""

    purpose: str = ""
    steps_seen: int = 0
    trained_on: str = ""
    radars: tuple[RadarSpec, ...] = ()  # of training; the first recorded the most
    sent_points: bool = False  # learned from points that a radar sent

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
    tables: Tables = Tables()
    card: Card = Card()

    def with_tables(self, **tables: Any) -> "Model":
        """Return the model with other tables, by their names in `Tables`."""
        return dataclasses.replace(self, tables=self.tables._replace(**tables))

    def tree_flatten_with_keys(self) -> tuple[Iterable[tuple[Any, Any]], Any]:
        """The parts that are arrays, and the static ones."""
        leaves = [
            (jax.tree_util.GetAttrKey(name), getattr(self, name))
            for name in ("params", "tables")
        ]
        return leaves, (self.spec, _Passenger(self.card))

    @classmethod
    def tree_unflatten(cls, static: Any, leaves: Iterable[Any]) -> "Model":
        """The model of parts that `tree_flatten_with_keys` returned."""
        spec, passenger = static
        params, tables = leaves
        return cls(params, spec, tables, passenger.card)

    def __repr__(self) -> str:
        """One line: grid, method, size, and what it was trained on."""
        leaves = jax.tree.leaves(self.params)
        size = sum(int(np.prod(np.shape(leaf))) for leaf in leaves) / 1e6
        spec, card = self.spec, self.card
        rows, columns, channels = spec.grid.image_shape
        return (
            f"Model({spec.grid.kind}, {spec.method}, {size:.3g} million parameters, "
            f"{rows} x {columns} x {channels}, {card.steps_seen:,} steps on "
            f"{card.trained_on or 'unknown data'})"
        )


class _Passenger(NamedTuple):
    """A card within a pytree's structure; all cards are equal there."""

    card: Card

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Passenger)

    def __hash__(self) -> int:
        return hash(_Passenger)
