"""A network F made into a denoiser D (Karras et al. 2022, Eq. 7 and Table 1).

    D(x; sigma) = c_skip x + c_out F(c_in x; ln(sigma) / 4)

F sees and predicts images of unit variance at every noise level. With the prediction
"edm", D is nearly the identity for small noise and nearly F alone for large noise; F
must then carry the noise of every pixel. With "clean", F is the image itself:
c_skip = 0 and c_out = sigma_data.

The network's patches may be too coarse to carry a pixel's noise. With the last two
predictions it does not have to: F says what the surroundings and the condition tell of
a pixel, and Bayes' rule adds what the pixel's own value x tells.

"gaussian": F has two channels for each of the image's, mean and log-spread,

    D(x; sigma) = m + (x - m) s^2 / (s^2 + sigma^2),  m = sigma_data F1,
                                                      s = sigma_data exp(4 tanh(F2 / 4))

which is "edm" with F = F1 / c_out where F2 = 0. "occupancy": pixels are 0 or 1,

    D(x; sigma) = sigmoid(F + ln(p / (1 - p)) + (x - 1/2) / sigma^2)

with p the share of occupied pixels, from sigma_data^2 = p (1 - p).
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion.noise import NoiseSpec

Image = Float[Array, "*batch row column channel"]
Level = Float[Array, "*batch"]
Network = Callable[[Image, Level], Image]
Denoiser = Callable[[Image, Level], Image]


def scalings(sigma: Level, noise: NoiseSpec) -> tuple[Level, Level, Level, Level]:
    """c_skip, c_out, c_in and c_noise at a noise level."""
    total = jnp.sqrt(sigma**2 + noise.sigma_data**2)
    if noise.prediction != "edm":
        c_skip, c_out = jnp.zeros_like(sigma), jnp.full_like(sigma, noise.sigma_data)
        return c_skip, c_out, 1 / total, jnp.log(sigma) / 4
    c_skip = noise.sigma_data**2 / total**2
    c_out = sigma * noise.sigma_data / total
    return c_skip, c_out, 1 / total, jnp.log(sigma) / 4


def precondition(network: Network, noise: NoiseSpec) -> Denoiser:
    """Denoiser `(x, sigma) -> x0` around a `network` `(x, c_noise) -> F`.

    `sigma` is one level for each image of the batch, or a scalar for all.
    """

    def denoise(x, sigma):
        sigma = jnp.broadcast_to(jnp.asarray(sigma, x.dtype), x.shape[:-3])
        *scales, c_noise = scalings(sigma, noise)
        c_skip, c_out, c_in = (c[..., None, None, None] for c in scales)
        variance = sigma[..., None, None, None] ** 2
        said = network(c_in * x, c_noise)
        if noise.prediction == "gaussian":
            mean, spread = jnp.split(said, 2, -1)
            mean, own = noise.sigma_data * mean, _variance(spread, noise)
            return mean + (x - mean) * own / (own + variance)
        if noise.prediction == "occupancy":
            return jax.nn.sigmoid(said + prior(noise) + (x - 0.5) / variance)
        return c_skip * x + c_out * said

    return denoise


def _variance(spread, noise):
    """s^2 of "gaussian", within e^-8 and e^8 times that of the data."""
    return noise.sigma_data**2 * jnp.exp(8 * jnp.tanh(spread / 4))


def prior(noise: NoiseSpec) -> float:
    """Log-odds of a pixel being occupied, of images that are 0 or 1."""
    share = (1 - math.sqrt(1 - 4 * noise.sigma_data**2)) / 2
    return math.log(share / (1 - share))
