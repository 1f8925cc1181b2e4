"""What a radar sees: paths, and the power that passes through surfaces on the way."""

import functools
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from jradar.radar import RadarSpec
from jradar.simulation.rig import Viewpoint
from jradar.simulation.scenes.materials import (
    MATERIALS,
    backscatter,
    mirror_share,
    slab_shares,
)
from jradar.simulation.scenes.scene import NUDGE_M, Placement, Scene, cast

MAX_SURFACES = 3  # that a path passes through
LEAST_TRANSMISSION = 1e-3
TOUCH_M = 0.02  # a ray that ends this near to its target reaches it
COSINES = 256  # entries of the tables over the angle to the normal


class Paths(NamedTuple):
    """Paths in the radar's frame; `power` is received, in mW at the antenna."""

    xyz: Float[np.ndarray, "path 3"]  # where the receivers see the echo
    departure: Float[np.ndarray, "path 3"]  # where the transmitters see it
    velocity: Float[np.ndarray, " path"]
    power: Float[np.ndarray, " path"]

    def chosen(self, index: np.ndarray) -> "Paths":
        """Return some of the paths."""
        return Paths(*(column[index] for column in self))


NO_PATHS = Paths(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def joined(parts: Iterable[Paths]) -> Paths:
    """Return the paths of all parts."""
    return Paths(*map(np.concatenate, zip(*parts, strict=True)))


class Sight(NamedTuple):
    """A radar in a scene at one time."""

    scene: Scene
    places: list[Placement]
    view: Viewpoint
    radar: RadarSpec

    @property
    def tables(self) -> "SurfaceTables":
        """Return the tables of the surfaces at the radar's frequency."""
        return surface_tables(self.radar.center_frequency_hz)


class SurfaceTables(NamedTuple):
    """Shares of the power by material and cosine (see `column_of`)."""

    reflected: Float[np.ndarray, "material cosine"]  # mirrored or scattered
    backscatter: Float[np.ndarray, "material cosine"]
    mirrored: Float[np.ndarray, "material cosine"]
    transmitted: Float[np.ndarray, "material cosine"]


@functools.lru_cache
def surface_tables(frequency_hz: float) -> SurfaceTables:
    """Return the tables of all materials at one frequency."""
    cosine = np.linspace(0, 1, COSINES)
    rows = []
    for material in MATERIALS:
        reflected, transmitted = slab_shares(material, cosine, frequency_hz)
        mirrored = reflected * mirror_share(material, cosine, frequency_hz)
        scattered = backscatter(material, cosine, frequency_hz)
        rows.append((reflected, scattered, mirrored, transmitted))
    return SurfaceTables(*np.array(rows).swapaxes(0, 1))


def column_of(cosine: Float[np.ndarray, "*batch"]) -> Int[np.ndarray, "*batch"]:
    """Return the tables' column of each cosine, 0 to 1."""
    return (cosine * (COSINES - 1)).astype(int)


def line_of_sight(
    sight: Sight, start: Float[np.ndarray, "*ray 3"], end: Float[np.ndarray, "ray 3"]
) -> tuple[Float[np.ndarray, " ray"], Bool[np.ndarray, " ray"]]:
    """Return the share of the power that reaches `end`, and whether a surface is there.

    `start` is one place, or one for each ray. The share is 0 behind more than
    `MAX_SURFACES` surfaces.
    """
    start = np.broadcast_to(start, end.shape)
    span = end - start
    length = np.linalg.norm(span, axis=-1)
    along = span / np.maximum(length, 1e-9)[:, None]
    through = np.ones(len(start))
    lands = np.zeros(len(start), bool)
    begin = np.zeros(len(start))
    live = np.arange(len(start))
    for _ in range(MAX_SURFACES + 1):
        if not live.size:
            break
        origin = start[live] + begin[live, None] * along[live]
        hits = cast(sight.scene, sight.places, origin, along[live])
        at = begin[live] + hits.distance
        lands[live] = np.abs(at - length[live]) < TOUCH_M
        blocked = at < length[live] - TOUCH_M
        live, at = live[blocked], at[blocked]
        column = column_of(hits.cosine[blocked])
        through[live] *= sight.tables.transmitted[hits.material[blocked], column]
        begin[live] = at + NUDGE_M
        live = live[through[live] > LEAST_TRANSMISSION]
    through[live] = 0.0  # still behind a surface
    through[through <= LEAST_TRANSMISSION] = 0.0
    return through, lands
