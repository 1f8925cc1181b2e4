"""A trained network as the denoiser that samplers and `enhance` take."""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array, Float

from jradar.diffusion.noise import NoiseSpec
from jradar.diffusion.precondition import Denoiser, precondition
from jradar.diffusion.unet import UNet

Condition = Float[Array, "batch row column channel"]
ConditionalDenoiser = Callable[[Condition], Denoiser]


def conditional_denoiser(
    network: UNet, params: Any, noise: NoiseSpec
) -> ConditionalDenoiser:
    """`condition -> ((x, sigma) -> x0)`; the condition is encoded only once."""

    def given(condition):
        features = network.apply(params, condition, method="encode")

        def decode(x, c_noise) -> Any:
            return network.apply(params, x, c_noise, features, method="decode")

        return precondition(decode, noise)

    return given
