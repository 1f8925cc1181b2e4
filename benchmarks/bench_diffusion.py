"""How long do one pass, its decision and a gradient take, compared with PyTorch?

The decision turns each pixel's mixture into the range whose window of +- 0.2 m holds
the most probability. The network is `tiny`, in float32. One pass has the paper's size
and is compiled as `jradar enhance` does. The gradient has images of half that size. The
peer is the same in PyTorch, whose results must equal ours before they are timed.
"""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import torch_unet
from benchmarks.harness import Call, Case, available, random_params
from jradar.diffusion import PRESETS, UNet
from jradar.diffusion.mixture import RangeMixture
from jradar.model import compiler_options, load_model
from jradar.model.grids.view.answers import SIDE_STEPS, TRIED, likeliest_range

BATCH, FINE, COARSE = 2, (64, 256, 2), (32, 32, 8)
COMPONENTS = 5  # of a mixture of `jradar-sim`
FARTHEST_M = 12.0  # of images of the paper's size
WINDOW_M = 0.2  # what is near in that view


def cases() -> Iterator[Case]:
    """Yield one pass and the gradient."""
    rng = np.random.default_rng(0)
    for frames in (1, 8, 32):
        yield _one_pass(rng, frames)
    for frames in (1, 8):
        yield _decision(rng, frames)
    network = UNet(**PRESETS["tiny"])
    x, clean = rng.normal(size=(2, BATCH, *FINE)).astype(np.float32)
    condition = rng.normal(size=(BATCH, *COARSE)).astype(np.float32)
    c_noise = np.linspace(-1, 0.5, BATCH, dtype=np.float32)
    inputs = tuple(map(jnp.asarray, (x, c_noise, condition)))
    params = random_params(network, *inputs)

    @jax.jit
    @jax.grad
    def gradient(params):
        return jnp.mean((network.apply(params, *inputs) - clean) ** 2)

    torch = TorchPeer(network, params, inputs, clean)
    size = f"batch {BATCH}, {FINE[0]} x {FINE[1]}"
    yield Case(
        f"tiny: gradient, {size}",
        lambda: gradient(params),
        available({"PyTorch": torch.gradient}),
        same=_close_trees,
    )


def _one_pass(rng, frames) -> Case:
    """The network of one pass, for images of the paper's size."""
    network = UNet(**PRESETS["tiny"], outputs=14)
    condition = jnp.asarray(rng.normal(size=(frames, 64, 64, 24)), jnp.float32)
    inputs = jnp.zeros((frames, 128, 512, 2)), jnp.zeros(frames), condition
    params = random_params(network, *inputs)
    forward = jax.jit(network.apply, compiler_options=compiler_options())
    torch = TorchPeer(network, params, inputs, np.zeros(0, np.float32))
    return Case(
        f"network of one pass, {frames} x 128 x 512",
        lambda: forward(params, *inputs),
        available({"PyTorch": torch.forward}),
        same=_close,
    )


def _decision(rng, frames) -> Case:
    """The likeliest range of each pixel of images of the paper's size."""
    shape = (frames, 128, 512, COMPONENTS)
    weight, centre = rng.random(shape), rng.uniform(-1, 1, shape)
    parts = (
        rng.normal(size=shape[:-1]),
        weight / weight.sum(-1, keepdims=True),
        centre,
        rng.uniform(0.005, 0.1, shape),
    )
    arrays = tuple(np.asarray(part, np.float32) for part in parts)
    mixture = RangeMixture(*map(jnp.asarray, arrays))
    grid = load_model("jradar-sim").spec.frame_grid
    decide = jax.jit(functools.partial(likeliest_range, grid=grid))
    torch = functools.partial(_likeliest_in_torch, arrays)
    return Case(
        f"decision, {frames} x 128 x 512, mixtures of {COMPONENTS}",
        lambda: decide(mixture),
        available({"PyTorch": torch}),
        same=_same_decision,
    )


def _likeliest_in_torch(arrays) -> Call:
    """Return a call that computes `likeliest_range`, of the codec "log"."""
    import torch

    returned, weight, centre, scale = map(torch.from_numpy, arrays)
    top = float(np.log1p(FARTHEST_M))
    # Components first, so that each is contiguous.
    parts = [part.movedim(-1, 0).contiguous() for part in (weight, centre, scale)]

    def code(range_m):
        return 2 * torch.log1p(range_m.clamp(0, FARTHEST_M)) / top - 1

    def mass(range_m):
        low, high = code(range_m - WINDOW_M), code(range_m + WINDOW_M)
        total = torch.zeros_like(range_m)
        for share, middle, width in zip(*parts, strict=True):
            above = torch.sigmoid((high - middle) / width)
            total += share * (above - torch.sigmoid((low - middle) / width))
        return total

    def best_of(ranges):
        ranges = torch.stack(ranges)
        masses = torch.stack([mass(range_m) for range_m in ranges])
        most, index = masses.max(0)
        return ranges.gather(0, index[None])[0], most

    def run():
        with torch.no_grad():
            tried = torch.expm1((parts[1][:TRIED].clamp(-1, 1) + 1) / 2 * top)
            best, _ = best_of([*tried])
            others = [best + step * WINDOW_M for step in SIDE_STEPS]
            best, most = best_of([best, *others])
            return best.clamp(min=0), torch.sigmoid(returned) * most

    return run


def _same_decision(ours, peer):
    """Return whether confidences agree, and ranges but for a few equal windows."""
    ranges = np.isclose(np.asarray(ours.range_m), peer[0], atol=1e-3)
    confidence = np.asarray(ours.confidence)
    return ranges.mean() > 0.999 and np.allclose(confidence, peer[1], atol=1e-4)


def _close(ours, peer):
    ours = np.asarray(ours)
    return np.allclose(ours, peer, rtol=1e-3, atol=1e-4 * np.abs(ours).max())


def _close_trees(ours, peer):
    """Return whether gradients agree, leaf by leaf, in float32."""
    ours = {
        "/".join(str(k.key) for k in path[1:]): np.asarray(leaf)
        for path, leaf in jax.tree_util.tree_leaves_with_path(ours)
    }
    largest = max(np.abs(leaf).max() for leaf in ours.values())
    close = functools.partial(np.allclose, rtol=1e-2, atol=1e-4 * largest)
    return ours.keys() == peer.keys() and all(
        close(leaf, torch_unet.to_flax(peer[name])) for name, leaf in ours.items()
    )


class TorchPeer(NamedTuple):
    """The same network in PyTorch, with the same parameters and inputs."""

    network: UNet
    params: Any
    inputs: tuple[jax.Array, ...]
    clean: np.ndarray

    def forward(self) -> Call:
        """Return a call that computes the output, channels last."""
        import torch

        weights, inputs = torch_unet.to_torch(self.params, self.inputs)

        def run():
            with torch.no_grad():
                output = torch_unet.network(self.network, weights, *inputs)
                return output.movedim(1, -1).numpy()

        return run

    def gradient(self) -> Call:
        """Return a call that computes the gradient of the mean squared error."""
        import torch

        weights, inputs = torch_unet.to_torch(self.params, self.inputs)
        target = torch.from_numpy(self.clean).movedim(-1, 1).contiguous()
        names = [*weights]

        def run():
            output = torch_unet.network(self.network, weights, *inputs)
            loss = ((output - target) ** 2).mean()
            slopes = torch.autograd.grad(loss, [weights[name] for name in names])
            return dict(zip(names, slopes, strict=True))

        return run
