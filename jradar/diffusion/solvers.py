"""The probability-flow ODE from noise to image, deterministic (Eq. 8).

With sigma(t) = t the ODE is dx/dsigma = (x - D(x; sigma)) / sigma. Heun's method of
second order takes all steps between noise levels in one `lax.scan`; the last step, to
sigma = 0, is the denoised image itself and stands outside: N levels cost 2 N - 1
evaluations. Functions that take a denoiser are not jitted: jit the whole around them.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, karras_sigmas
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "*batch row column channel"]


def sample(
    key: Key[Array, ""],
    denoise: Denoiser,
    shape: tuple[int, ...],
    *,
    noise: NoiseSpec,
    steps: int = 18,
) -> Image:
    """Draw images of `shape` [*batch, row, column, channel] with Heun's method.

    `steps=1` is the one-step estimate, nearly the mean of all images that the
    condition allows.
    """
    start = noise.sigma_max * jax.random.normal(key, shape)
    return heun(denoise, start, karras_sigmas(steps, noise))


def heun(denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
    """Solve the ODE from `x` at level `sigmas[0]` through all levels down to 0."""
    levels = jnp.asarray(sigmas, x.dtype)
    pairs = jnp.stack([levels[:-1], levels[1:]], axis=-1)

    def step(x, pair):
        return heun_step(denoise, x, pair[0], pair[1]), None

    x, _ = jax.lax.scan(step, x, pairs)
    return denoise(x, levels[-1])


def heun_step(
    denoise: Denoiser,
    x: Image,
    sigma: Float[Array, ""],
    after: Float[Array, ""],
) -> Image:
    """One step of second order from level `sigma` to level `after` > 0."""
    slope = (x - denoise(x, sigma)) / sigma
    euler = x + (after - sigma) * slope
    slope_after = (euler - denoise(euler, after)) / after
    return x + (after - sigma) * (slope + slope_after) / 2
