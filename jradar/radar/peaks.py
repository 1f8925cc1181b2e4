"""Where between the bins a peak lies."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Power = Float[Array, "*batch"]


def parabola_offset(before: Power, peak: Power, after: Power) -> Power:
    """Bins from a peak to the vertex of the parabola through three log powers.

    Between -0.5 and 0.5, and 0 where the three do not bend downwards. Neighbours more
    than 60 dB below the peak are rounding, and count as that. Differentiable, which the
    position of a largest bin is not.
    """
    least = 1e-6 * peak + 1e-30
    before, peak, after = (
        jnp.log(jnp.maximum(power, least)) for power in (before, peak, after)
    )
    bend = 2 * peak - before - after
    bent = bend > 0
    offset = (after - before) / (2 * jnp.where(bent, bend, 1.0))
    return jnp.clip(jnp.where(bent, offset, 0.0), -0.5, 0.5)
