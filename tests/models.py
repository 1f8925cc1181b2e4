"""Tiny random models and a room's echoes, which the tests of several rooms share."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar.diffusion import OCCUPANCY, PREDICTIONS, NoiseSpec, UNet
from jradar.model import (
    Card,
    ColumnGrid,
    Model,
    ModelSpec,
    PolarGrid,
    Tables,
    ViewGrid,
)
from jradar.model.grids.columns import NOISE
from jradar.model.grids.polar import RADARHD, Scaling
from jradar.radar import PointSpec, RadarSpec, Scatterers, simulate_cube
from jradar.range_image import IDENTITY, ConfidenceTable, ImageSpec

NETWORK = UNet(channels=8, multipliers=(1,), blocks=1, attention_levels=())
SPEC = ModelSpec(
    method="diffusion",
    network=NETWORK,
    noise=NoiseSpec(sigma_data=0.7),
    grid=ViewGrid(ImageSpec(8, 8), ImageSpec(8, 32), num_slices=4, codec="inverse"),
    points=PointSpec(capacity=64, guard=(1, 2)),
)
GRID = SPEC.frame_grid
RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
CARD = Card("nothing", 7, "a test", (RADAR,))
CONDITION_SHAPE = (8, 8, 12)


def random_params(network, image, condition, *, scale=0.1):
    """Random parameters of a network for these shapes, where `init` has zeros."""
    image, condition = jnp.zeros((1, *image)), jnp.zeros((1, *condition))
    key, rng = jax.random.key(0), np.random.default_rng(0)
    shapes = jax.eval_shape(network.init, key, image, jnp.zeros(1), condition)

    def drawn(leaf):
        return jnp.asarray(scale * rng.normal(size=leaf.shape), leaf.dtype)

    return jax.tree.map(drawn, shapes)


def changed(spec: ModelSpec, **changes: Any) -> ModelSpec:
    """A spec with other fields, its own or its grid's."""
    fields = {field.name for field in dataclasses.fields(spec)}
    own = {name: changes.pop(name) for name in fields & changes.keys()}
    return dataclasses.replace(
        spec, **{"grid": dataclasses.replace(spec.grid, **changes)} | own
    )


def tiny_model(*, confidence=IDENTITY, card: Card = CARD, **changes: Any) -> Model:
    """A model of random parameters; `changes` are those of `changed`."""
    spec = changed(SPEC, **changes)
    shapes = spec.grid.image_shape, spec.grid.condition_shape
    params = random_params(spec.network, *shapes)
    return Model(params, spec, Tables(confidence), card)


def one_pass_model() -> Model:
    """A model that answers in one pass, with every pixel whatever its confidence."""
    return tiny_model(
        method="marginal",
        network=dataclasses.replace(NETWORK, outputs=14),
        noise=NoiseSpec(sigma_data=0.7, prediction=PREDICTIONS["mixture"]),
        confidence=ConfidenceTable.of((0.0, 1.0), least=0.0),
    )


def echoes(seed: int = 0) -> jax.Array:
    """A cube of 20 targets at rest in front of the radar."""
    key = jax.random.key(seed)
    place = jax.random.uniform(key, (20, 3), minval=-1.0, maxval=1.0)
    ahead = place + jnp.array([3.0, 0.0, 0.0])
    targets = Scatterers(ahead, jnp.zeros(20), jnp.full(20, 50.0))
    return simulate_cube(key, targets, RADAR, noise_power=1.0)


def tiny_map_model(method: str = "occupancy") -> Model:
    """A model of maps of random parameters, of 16 heights and tiles of 32 columns."""
    fields = {"stem": (2, 2), "condition_stem": (2, 2), "condition_channels": 8}
    fields |= {"detail_channels": 0, "outputs": 16, "angles": False}
    network = dataclasses.replace(NETWORK, **fields)
    grid = ColumnGrid(heights=16, tile=32)
    params = random_params(network, grid.image_shape, grid.condition_shape, scale=0.2)
    spec = ModelSpec(method, network, NOISE[method], grid)
    return Model(params, spec, card=Card("nothing", 7, "nothing"))


def tiny_polar_model(*, history: int = 1, **changes: Any) -> Model:
    """A model of polar images of random parameters, whose pixels differ."""
    fields = {"stem": (16, 32), "condition_stem": (16, 4), "condition_channels": 8}
    network = dataclasses.replace(NETWORK, **fields, detail_channels=0, outputs=1)
    noise = NoiseSpec(sigma_data=0.5, sigma_max=20.0, prediction=OCCUPANCY)
    grid, points = PolarGrid(history), PointSpec(capacity=64, guard=(1, 2))
    fields = {"method": "occupancy", "points": points} | changes
    spec = ModelSpec(network=network, noise=noise, grid=grid, **fields)
    params = random_params(network, grid.image_shape, grid.condition_shape, scale=0.5)
    table = ConfidenceTable.of((0.0, 1.0), least=0.6, least_alone=0.0)
    unscaled = Scaling.of((0, 0), (1, 0))
    tables = Tables(table, scaling=unscaled)
    return Model(params, spec, tables, Card("nothing", 7, "a test", (RADARHD,)))
