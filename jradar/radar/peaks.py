"""The position of a peak between bins."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Power = Float[Array, "*batch"]


def parabola_offset(before: Power, peak: Power, after: Power) -> Power:
    """Return the bins from a peak to the vertex of a parabola through three log powers.

    The result lies between -0.5 and 0.5; it is 0 where the three powers do not bend
    downwards. Neighbours are raised to 60 dB below the peak, because anything lower is
    rounding. Unlike the index of the largest bin, the offset is differentiable.
    """
    least = 1e-6 * peak + 1e-30
    before, peak, after = (
        jnp.log(jnp.maximum(power, least)) for power in (before, peak, after)
    )
    bend = 2 * peak - before - after
    bent = bend > 0
    offset = (after - before) / (2 * jnp.where(bent, bend, 1.0))
    return jnp.clip(jnp.where(bent, offset, 0.0), -0.5, 0.5)
