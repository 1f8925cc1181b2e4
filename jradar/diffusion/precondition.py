"""A network made into a denoiser D(x; sigma) (Karras et al. 2022, Eq. 7).

The rule by which the network's output becomes a clean image belongs to the prediction
(`predictions`).
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion.network import Network
from jradar.diffusion.noise import NoiseSpec
from jradar.diffusion.predictions import Image, Level, NetworkFunction, Output

Condition = Float[Array, "batch row column channel"]
Denoiser = Callable[[Image, Level], Output]
ConditionalDenoiser = Callable[[Condition], Denoiser]


def precondition(network: NetworkFunction, noise: NoiseSpec) -> Denoiser:
    """Return the denoiser `(x, sigma) -> x0` around a network `(x, c_noise) -> F`.

    `sigma` is one level for each image of the batch, or a scalar for all.
    """

    def denoise(x, sigma):
        sigma = jnp.broadcast_to(jnp.asarray(sigma, x.dtype), x.shape[:-3])
        return noise.prediction.denoise(network, x, sigma, noise.sigma_data)

    return denoise


def conditional_denoiser(
    network: Network, params: Any, noise: NoiseSpec
) -> ConditionalDenoiser:
    """Return `condition -> ((x, sigma) -> x0)`, which encodes the condition once."""

    def given(condition):
        features = network.apply(params, condition, method="encode")

        def decode(x, c_noise) -> Any:
            return network.apply(params, x, c_noise, features, method="decode")

        return precondition(decode, noise)

    return given
