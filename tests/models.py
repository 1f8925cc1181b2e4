"""One tiny random model, which the tests of several rooms share."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar.diffusion import NoiseSpec, UNet
from jradar.model import Card, Model, ModelSpec
from jradar.radar import PointSpec, RadarSpec
from jradar.range_image import IDENTITY, ConfidenceTable, ImageSpec

SPEC = ModelSpec(
    method="diffusion",
    network=UNet(channels=8, multipliers=(1,), blocks=1, attention_levels=()),
    noise=NoiseSpec(sigma_data=0.7),
    coarse=ImageSpec(8, 8),
    fine=ImageSpec(8, 32),
    points=PointSpec(capacity=64, guard=(1, 2)),
    num_slices=4,
    codec="inverse",
)
RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
CARD = Card("nothing", 7, "a test", (RADAR,))


def tiny_model(
    *, confidence: ConfidenceTable = IDENTITY, card: Card = CARD, **changes: Any
) -> Model:
    """A model of random parameters; `changes` replace fields of its spec."""
    spec = dataclasses.replace(SPEC, **changes)
    shapes = jax.eval_shape(
        spec.network.init,
        jax.random.key(0),
        jnp.zeros((1, *spec.fine.shape, 2)),
        jnp.zeros(1),
        jnp.zeros((1, *spec.coarse.shape, 3 * spec.num_slices)),
    )
    rng = np.random.default_rng(0)
    params = jax.tree.map(
        lambda leaf: jnp.asarray(0.1 * rng.normal(size=leaf.shape), leaf.dtype), shapes
    )
    return Model(params, spec, card, confidence)
