"""How long do one pass and a gradient take, compared with PyTorch?

The network is `tiny`, in float32. One pass has the paper's size and is compiled as
`jradar enhance` does. The gradient has images of half that size. The peer is the same
network in PyTorch: output and gradient must equal ours before they are timed.
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
from jradar.model import compiler_options

BATCH, FINE, COARSE = 2, (64, 256, 2), (32, 32, 8)


def cases() -> Iterator[Case]:
    """Yield one pass and the gradient."""
    rng = np.random.default_rng(0)
    for frames in (1, 8, 32):
        yield _one_pass(rng, frames)
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
