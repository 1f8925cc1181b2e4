"""A network F made into a denoiser D (Karras et al. 2022, Eq. 7 and Table 1).

    D(x; sigma) = c_skip x + c_out F(c_in x; ln(sigma) / 4)

F sees and predicts images of unit variance at every noise level. With the prediction
"edm", D is nearly the identity for small noise and nearly F alone for large noise; F
must then carry the noise of every pixel. With "clean", F is the image itself:
c_skip = 0 and c_out = sigma_data.
"""

from collections.abc import Callable

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
    if noise.prediction == "clean":
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
        c_skip, c_out, c_in, c_noise = scalings(sigma, noise)
        c_skip, c_out, c_in = (c[..., None, None, None] for c in (c_skip, c_out, c_in))
        return c_skip * x + c_out * network(c_in * x, c_noise)

    return denoise
