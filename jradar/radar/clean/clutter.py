"""Static clutter of a radar that stands still, and its subtraction.

    frames --static_background--> background --subtract_background--> cube without it

What stands still gives the same samples in every chirp of every frame. Their mean over
a recording keeps little of what moves, even slowly: unlike the mean over one frame that
`remove_static` subtracts, which also removes people who stop. The leakage of the
antennas is part of the background, so that no `coupling` must be subtracted with it.

The phase of a real radar's background drifts by some hundredths of a radian as the
radar warms up, from frame to frame and within a frame. A factor for each chirp, the
same for all antennas, follows it. A subspace of several components would follow more,
but would also contain people who walk through the background's frames.
"""

from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Inexact, Num

from jradar.compiled import jit
from jradar.radar.ranks import to_rank
from jradar.radar.samples import Cube, as_samples
from jradar.radar.spectrum import window


def static_background(
    frames: Iterable[Num[Array | np.ndarray, "*_batch _tx _rx _chirp _sample"]],
) -> Inexact[Array, "*_batch _tx _rx _sample"]:
    """Return the mean of the samples over frames and chirps, on the host.

    Frames are taken one by one, so that a recording need not fit into memory. Raises
    ValueError without frames.
    """
    total, count = jnp.zeros(()), 0
    for cube in frames:
        total, count = total + as_samples(jnp.asarray(cube)).mean(-2), count + 1
    if not count:
        raise ValueError("the background is a mean of frames, but there are none")
    return total / count


@jit
def subtract_background(
    cube: Cube, background: Inexact[Array, "_tx _rx _sample"]
) -> Inexact[Array, "*batch tx rx chirp sample"]:
    """Subtract the background, scaled by the factor that fits each chirp best.

    The factor is complex for complex samples. The fit is weighted by a Hann window over
    samples, so that echoes in other range bins do not disturb it. A background of zeros
    changes nothing. Raises ValueError for a background of another radar.
    """
    cube = as_samples(cube)
    expected = *cube.shape[-4:-2], cube.shape[-1]
    if background.shape != expected:
        raise ValueError(
            f"background of shape {background.shape}, the cube needs [tx, rx, sample] "
            f"= {expected}: of another radar?"
        )
    weight = to_rank(np.asarray(window("hann", cube.shape[-1]), cube.real.dtype), cube)
    known = to_rank(background[:, :, None], cube)
    fitted = jnp.conj(known) * weight**2
    fit = (fitted * cube).sum((-4, -3, -1), keepdims=True)
    power = (fitted * known).real.sum()
    factor = fit / jnp.where(power > 0, power, 1)
    return cube - factor * known
