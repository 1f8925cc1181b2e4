"""Metres to a network's range code, -1 .. 1, and back.

Images of ranges and the networks that draw them share the code. It grows with the view:
in one of 60 m, 5 m have the code that 1 m has in one of 12.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Codec(NamedTuple):
    """A pair of inverse functions of (value, max_range_m)."""

    encode: Callable[[Array, float], Array]  # metres to 0 .. 1
    decode: Callable[[Array, float], Array]  # 0 .. 1 to metres


USUAL_M = 12.0  # a view in which the codecs' unit of range is 1 m


def _decode_inverse(unit, most):
    share = unit * (USUAL_M / (1 + USUAL_M))
    return share / (1 - share) * (most / USUAL_M)


def _encode_inverse(r, most):
    r = r * (USUAL_M / most)
    return r / (1 + r) * ((1 + USUAL_M) / USUAL_M)


CODECS = {
    "log": Codec(
        lambda r, most: jnp.log1p(r * (USUAL_M / most)) / math.log1p(USUAL_M),
        lambda unit, most: jnp.expm1(unit * math.log1p(USUAL_M)) * (most / USUAL_M),
    ),
    "linear": Codec(lambda r, most: r / most, lambda unit, most: unit * most),
    "inverse": Codec(_encode_inverse, _decode_inverse),
}


def encode_range(
    range_m: Float[Array, "..."], *, max_range_m: float, codec: str = "log"
) -> Float[Array, "..."]:
    """Return -1 .. 1 for 0 .. `max_range_m` metres, and 1 beyond.

    Raises ValueError for a codec that is not in `CODECS`.
    """
    r = jnp.clip(range_m, 0.0, max_range_m)
    return 2 * _codec(codec).encode(r, max_range_m) - 1


def decode_range(
    value: Float[Array, "..."], *, max_range_m: float, codec: str = "log"
) -> Float[Array, "..."]:
    """Return metres: the inverse of `encode_range`, of values clipped to -1 .. 1."""
    unit = (jnp.clip(value, -1.0, 1.0) + 1) / 2
    return _codec(codec).decode(unit, max_range_m)


def _codec(name):
    """The codec of this name."""
    if name not in CODECS:
        raise ValueError(f"codec = {name!r}, expected one of {[*CODECS]}")
    return CODECS[name]
