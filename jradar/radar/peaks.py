"""The peaks of a map, and the position of a peak between bins."""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.radar.spectrum import window

Power = Float[Array, "*batch"]

SHORTEST = 8  # window for which the parabola's bias is known
DEGREES = (1, 3, 5, 7)  # of the polynomial that removes it


def local_maxima(
    power: Float[Array, "*batch row column"],
) -> Bool[Array, "*batch row column"]:
    """Return the cells that exceed their eight neighbours; of equal ones, one counts.

    Both axes wrap around.
    """
    rows, columns = ((-1, 0, 1) if n > 2 else (0,) for n in power.shape[-2:])
    highest = jnp.ones(power.shape, bool)
    for shift in ((row, column) for row in rows for column in columns):
        near = jnp.roll(power, shift, (-2, -1))
        if shift != (0, 0):
            highest &= power > near if shift > (0, 0) else power >= near
    return highest


def parabola_offset(before: Power, peak: Power, after: Power) -> Power:
    """Return the bins from a peak to the vertex of a parabola through three log powers.

    The result lies between -0.5 and 0.5; it is 0 where the three powers do not bend
    downwards. Neighbours are raised to 60 dB below the peak, because anything lower is
    rounding. Unlike the index of the largest bin, the offset is differentiable.
    """
    return jnp.clip(_vertex(before, peak, after), -0.5, 0.5)


def window_offset(
    before: Power, peak: Power, after: Power, *, kind: str, length: int
) -> Power:
    """Return `parabola_offset` of a windowed spectrum without the parabola's bias.

    A window's main lobe is not a parabola: with "hann" the vertex is up to 0.016 bins
    off the target. A window of "none", or of fewer than 8 values, is not corrected.
    """
    offset = _vertex(before, peak, after)
    scale, *higher = unbiased_coefficients(kind, length)
    square = offset**2
    total = jnp.zeros_like(offset)
    for coefficient in reversed(higher):
        total = (total + coefficient) * square
    return jnp.clip(offset * (scale + total), -0.5, 0.5)


@functools.cache
def unbiased_coefficients(kind: str, length: int) -> tuple[float, ...]:
    """Return the polynomial of odd degrees from the vertex to the target; host."""
    if kind == "none" or length < SHORTEST:
        return (1.0, *(0.0 for _ in DEGREES[1:]))
    offset = np.linspace(-0.5, 0.5, 101)
    vertex, _ = vertex_and_slopes(np.log(np.abs(lobe(kind, length, offset)) ** 2))
    powers = np.stack([vertex**degree for degree in DEGREES], -1)
    solution, *_ = np.linalg.lstsq(powers, offset)
    return tuple(map(float, solution))


def lobe(kind: str, length: int, offset: np.ndarray) -> np.ndarray:
    """Return the window's spectrum in the bins before, at and after a peak; host.

    The target lies `offset` bins after the middle one: `[*offset, 3]`, complex.
    """
    bins = np.asarray(offset)[..., None] - np.array([-1, 0, 1])
    phase = 2 * np.pi * bins[..., None] * np.arange(length) / length
    return (window(kind, length) * np.exp(1j * phase)).sum(-1)


def vertex_and_slopes(logs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertex for log powers `[*batch, 3]`, and its derivatives; host."""
    before, peak, after = np.moveaxis(logs, -1, 0)
    bend, slope = 2 * peak - before - after, after - before
    tilt = slope / (2 * bend**2)
    slopes = np.stack([tilt - 0.5 / bend, -2 * tilt, tilt + 0.5 / bend], -1)
    return slope / (2 * bend), slopes


def _vertex(before, peak, after):
    """Bins to the vertex, which may lie a little more than half a bin away."""
    # Stacked, because XLA compiles one long kernel then instead of three.
    powers = jnp.stack(jnp.broadcast_arrays(before, peak, after))
    before, peak, after = jnp.log(jnp.maximum(powers, (1e-6 * peak + 1e-30)[None]))
    bend = 2 * peak - before - after
    bent = bend > 0
    offset = (after - before) / (2 * jnp.where(bent, bend, 1.0))
    return jnp.clip(jnp.where(bent, offset, 0.0), -0.55, 0.55)
