"""Explicit broadcasting, for users who set `jax_numpy_rank_promotion="raise"`."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Shaped


def to_rank(values: Any, like: Shaped[Array, "..."]) -> Shaped[Array, "..."]:
    """Return an array with as many axes as `like`: leading axes of 1 are added."""
    values = jnp.asarray(values)
    return values.reshape((1,) * (like.ndim - values.ndim) + values.shape)
