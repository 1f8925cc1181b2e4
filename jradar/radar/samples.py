"""ADC samples of any number type as the complex or real floats that kernels compute in.

    integers [..., sample, 2]     I and Q in this order, as boards deliver them: complex
    integers [..., sample]        real samples, of a receiver with one mixer
    float16, bfloat16             real samples in half precision
    float32, complex64 and wider  unchanged

A chirp of two samples does not exist, so a last axis of 2 can only be I and Q.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Inexact, Num

Cube = Num[Array | np.ndarray, "*_batch _tx _rx _chirp _sample"]


def as_samples(cube: Cube) -> Inexact[Array, "*_batch _tx _rx _chirp _sample"]:
    """Return the samples of a cube as float32 or complex64, wider ones unchanged.

    Raises ValueError for a cube without all four axes and for one of booleans.
    """
    shape = jnp.shape(cube)
    cube = jnp.asarray(cube)
    if cube.dtype == bool:
        raise ValueError("the samples are bool, expected ADC samples")
    if jnp.issubdtype(cube.dtype, jnp.integer):
        cube = cube.astype(jnp.float32)
        if shape[-1:] == (2,):
            cube = jax.lax.complex(cube[..., 0], cube[..., 1])
    elif cube.dtype in (jnp.float16, jnp.bfloat16):
        cube = cube.astype(jnp.float32)
    if cube.ndim < 4:
        raise ValueError(
            f"cube has shape {shape}, expected [..., tx, rx, chirp, sample]: add the "
            "axes that are missing, such as cube[None, None] for one antenna"
        )
    return cube
