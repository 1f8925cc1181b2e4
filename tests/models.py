"""Tiny random models and a room's echoes, which the tests of several rooms share."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jradar.planar import LIDAR, RADARHD, PlanarModel, PlanarSpec

from jradar.diffusion import OCCUPANCY, PREDICTIONS, NoiseSpec, UNet
from jradar.mapping import MapModel, MapSpec
from jradar.model import Card, Model, ModelSpec
from jradar.radar import PointSpec, RadarSpec, Scatterers, simulate_cube
from jradar.range_image import IDENTITY, ConfidenceTable, ImageSpec

NETWORK = UNet(channels=8, multipliers=(1,), blocks=1, attention_levels=())
SPEC = ModelSpec(
    method="diffusion",
    network=NETWORK,
    noise=NoiseSpec(sigma_data=0.7),
    coarse=ImageSpec(8, 8),
    fine=ImageSpec(8, 32),
    points=PointSpec(capacity=64, guard=(1, 2)),
    num_slices=4,
    codec="inverse",
)
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


def tiny_model(*, confidence=IDENTITY, card: Card = CARD, **changes: Any) -> Model:
    """A model of random parameters; `changes` replace fields of its spec."""
    spec = dataclasses.replace(SPEC, **changes)
    shapes = (*spec.fine.shape, 2), (*spec.coarse.shape, 3 * spec.num_slices)
    return Model(random_params(spec.network, *shapes), spec, card, confidence)


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


def tiny_map_model() -> MapModel:
    """A model of maps of random parameters, of 16 heights and tiles of 32 columns."""
    spec = MapSpec(heights=16, tile=32)
    fields = {"stem": (2, 2), "condition_stem": (2, 2), "condition_channels": 8}
    fields |= {"detail_channels": 0, "outputs": 16, "angles": False}
    network = dataclasses.replace(NETWORK, **fields)
    params = random_params(network, (32, 32, 16), (32, 32, 19), scale=0.2)
    return MapModel(params, network, spec, trained_on="nothing")


def tiny_planar_model(**changes: Any) -> PlanarModel:
    """A planar model of random parameters, whose pixels differ in confidence."""
    fields = {"stem": (16, 32), "condition_stem": (16, 4), "condition_channels": 8}
    network = dataclasses.replace(NETWORK, **fields, detail_channels=0, outputs=1)
    noise = NoiseSpec(sigma_data=0.5, sigma_max=20.0, prediction=OCCUPANCY)
    points = PointSpec(capacity=64, guard=(1, 2))
    spec = PlanarSpec(network, noise, **{"points": points} | changes)
    params = random_params(network, (*LIDAR.shape, 1), spec.condition_shape, scale=0.5)
    card = Card("nothing", 7, "a test", (RADARHD,))
    table = ConfidenceTable.of((0.0, 1.0))
    return PlanarModel(params, spec, card, table, least_share=0.6)
