"""Where between the bins a peak lies."""

import jax.numpy as jnp
from jaxtyping import Array, Float

Power = Float[Array, "*batch"]


def parabola_offset(before: Power, peak: Power, after: Power) -> Power:
    """Bins from a peak to the vertex of the parabola through three log powers.

    Between -0.5 and 0.5, and 0 where the three do not bend downwards. Differentiable,
    which the position of a largest bin is not.
    """
    before, peak, after = (jnp.log(power + 1e-30) for power in (before, peak, after))
    bend = 2 * peak - before - after
    bent = bend > 0
    offset = (after - before) / (2 * jnp.where(bent, bend, 1.0))
    return jnp.clip(jnp.where(bent, offset, 0.0), -0.5, 0.5)
