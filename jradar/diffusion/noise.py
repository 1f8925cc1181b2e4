"""Noise levels of EDM (Karras et al. 2022), for training and for sampling.

The network sees a clean image x0 as x0 + sigma n. Training draws sigma from a
log-normal distribution; sampling walks down from `sigma_max` to 0.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.predictions import EDM, Prediction


@dataclasses.dataclass(frozen=True)
class NoiseSpec:
    """EDM's noise levels for training and sampling, and what the network predicts.

    `sigma_data` is the standard deviation of the clean images; `prediction` is an
    object of `PREDICTIONS`, or another that follows its protocol.
    """

    sigma_data: float = 0.5
    sigma_min: float = 0.002
    sigma_max: float = 80.0
    rho: float = 7.0
    log_mean: float = -1.2
    log_std: float = 1.2
    prediction: Prediction = EDM

    def __post_init__(self):
        if not self.sigma_data > 0:
            raise ValueError(f"sigma_data = {self.sigma_data}, expected more than 0")
        if not 0 < self.sigma_min < self.sigma_max:
            raise ValueError(
                f"sigma_min = {self.sigma_min}, sigma_max = {self.sigma_max}, "
                "expected 0 < sigma_min < sigma_max"
            )
        self.prediction.check(self.sigma_data)


def training_sigma(
    key: Key[Array, ""], shape: tuple[int, ...], noise: NoiseSpec
) -> Float[Array, "..."]:
    """Return random noise levels to train at: ln sigma is normal."""
    return jnp.exp(noise.log_mean + noise.log_std * jax.random.normal(key, shape))


def karras_sigmas(steps: int, noise: NoiseSpec) -> np.ndarray:
    """Return sampling levels from `sigma_max` to `sigma_min`, `[steps]`, on the host.

    They are Eq. 5 of Karras et al. in float64, without the final 0.
    """
    if steps < 1:
        raise ValueError(f"{steps=}, expected 1 or more")
    ramp = np.linspace(0.0, 1.0, steps) if steps > 1 else np.zeros(1)
    high, low = (
        sigma ** (1 / noise.rho) for sigma in (noise.sigma_max, noise.sigma_min)
    )
    return (high + ramp * (low - high)) ** noise.rho
