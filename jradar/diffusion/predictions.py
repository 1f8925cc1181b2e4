"""What a network predicts, and how that becomes a clean image (Karras et al. 2022).

The network F sees images of unit variance at every noise level sigma:

    D(x; sigma) = rule(F(x / sqrt(sigma^2 + sigma_data^2); ln(sigma) / 4), x, sigma)

A prediction is an object that carries its rule:

edm        D = c_skip x + c_out F (Table 1). D is nearly the identity for weak noise and
           nearly F alone for strong noise; F must carry the noise of every pixel.
clean      D = sigma_data F: the image itself.
gaussian   D = m + (x - m) s^2 / (s^2 + sigma^2), with a mean m = sigma_data F1 and a
           spread s = sigma_data exp(4 tanh(F2 / 4)) for each value of the image.

mixture    not an image, but a distribution of each pixel's range (`mixture`).

With patches too coarse to carry a pixel's noise, "gaussian" lets F describe a
pixel by its surroundings and the condition, and Bayes' rule adds the evidence of the
pixel's own value. It equals "edm" with F = F1 / c_out where F2 = 0.
"""

import abc
import dataclasses
from collections.abc import Callable
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Image = Float[Array, "*batch row column channel"]
ImageOrShape = Image | jax.ShapeDtypeStruct  # only the shape of an image of zeros
Level = Float[Array, "*batch"]
Output = Float[Array, "*batch row column output"]
NetworkFunction = Callable[[ImageOrShape, Level], Output]


@dataclasses.dataclass(frozen=True)
class Prediction(abc.ABC):
    """What a network predicts; configs and model files hold its `name`.

    `data` is sigma_data, `sigma` one level for each image.
    """

    name: str
    outputs_per_channel: int = 1  # of the network, for each channel of the image
    gives_image: ClassVar[bool] = True  # what `denoise` returns

    @abc.abstractmethod
    def denoise(
        self, network: NetworkFunction, x: Image, sigma: Level, data: float
    ) -> Output:
        """Return the clean image."""

    def loss_weight(self, sigma: Level, data: float) -> Level:
        """Return the weight of the squared error; EDM's gives F unit variance."""
        return (sigma**2 + data**2) / (sigma * data) ** 2

    def check(self, data: float) -> None:  # noqa: B027  (all, by default)
        """Raise ValueError for a `data` that the prediction cannot use."""


class Edm(Prediction):
    """EDM's mixture of image and noise."""

    def denoise(
        self, network: NetworkFunction, x: Image, sigma: Level, data: float
    ) -> Image:
        """Return c_skip x + c_out F."""
        *scales, c_noise = scalings(sigma, data)
        c_skip, c_out, c_in = (c[..., None, None, None] for c in scales)
        return c_skip * x + c_out * network(c_in * x, c_noise)


class Clean(Prediction):
    """The clean image, in units of `sigma_data`."""

    def loss_weight(self, sigma: Level, data: float) -> Level:
        """Return the same weight for all noise levels."""
        return jnp.full_like(sigma, 1 / data**2)

    def denoise(
        self, network: NetworkFunction, x: Image, sigma: Level, data: float
    ) -> Image:
        """Return sigma_data F."""
        return data * network_output(network, x, sigma, data)


class Gaussian(Prediction):
    """A mean and a spread for each value of the image, combined with its own value."""

    def denoise(
        self, network: NetworkFunction, x: Image, sigma: Level, data: float
    ) -> Image:
        """Return the mean of the posterior; spreads are e^-4 to e^4 of the data's."""
        mean, spread = jnp.split(network_output(network, x, sigma, data), 2, -1)
        mean = data * mean
        own = data**2 * jnp.exp(8 * jnp.tanh(spread / 4))
        variance = sigma[..., None, None, None] ** 2
        return mean + (x - mean) * own / (own + variance)


class Mixture(Prediction):
    """The parameters of a distribution for each pixel, in units of the image."""

    gives_image = False

    def denoise(
        self,
        network: NetworkFunction,
        x: ImageOrShape,
        sigma: Level,
        data: float,
    ) -> Output:
        """Return sigma_data F, with as many channels as F; `x` may be a shape.

        Channels beyond those of `COMPONENTS` are anchors, which have no unit.
        """
        output = network_output(network, x, sigma, data)
        unit = np.where(np.arange(output.shape[-1]) < FREE, data, 1.0)
        return output * jnp.asarray(unit, output.dtype)[None, None, None]


COMPONENTS = 4  # of a mixture, without anchors
FREE = 2 + 3 * COMPONENTS  # channels of these, of the return, and of the centre
EDM = Edm("edm")
PREDICTIONS: dict[str, Prediction] = {
    prediction.name: prediction
    for prediction in (
        EDM,
        Clean("clean"),
        Gaussian("gaussian", 2),
        Mixture("mixture", FREE // 2),
    )
}


def scalings(sigma: Level, data: float) -> tuple[Level, Level, Level, Level]:
    """Return EDM's c_skip, c_out, c_in and c_noise at a noise level."""
    total = jnp.sqrt(sigma**2 + data**2)
    c_skip = data**2 / total**2
    c_out = sigma * data / total
    return c_skip, c_out, 1 / total, jnp.log(sigma) / 4


def network_output(
    network: NetworkFunction, x: ImageOrShape, sigma: Level, data: float
) -> Output:
    """Return the network's output for an image scaled to unit variance.

    Only the shape of an image of zeros is passed on as it is.
    """
    _, _, c_in, c_noise = scalings(sigma, data)
    if isinstance(x, jax.ShapeDtypeStruct):
        return network(x, c_noise)
    return network(c_in[..., None, None, None] * x, c_noise)
