"""Which part of a training step takes how long, and how long does PyTorch take?

The forward pass, the gradient and the whole step, which also draws noise, are timed for
the network `tiny`. Images have half the paper's size; numbers are float32. The peer is
the same network in PyTorch with its fused Adam: forward pass and gradient must equal
ours before they are timed.
"""

import functools
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from benchmarks import torch_unet
from benchmarks.harness import Call, Case, available, random_params
from jradar.diffusion import PRESETS, NoiseSpec, UNet
from jradar.training import Batch, TrainState, make_train_step

BATCH, FINE, COARSE = 2, (64, 256, 2), (32, 32, 8)
OPTIMIZER = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(1e-4))


def cases() -> Iterator[Case]:
    """Yield the forward pass, the gradient, and the whole step."""
    network = UNet(**PRESETS["tiny"])
    rng = np.random.default_rng(0)
    x, clean = rng.normal(size=(2, BATCH, *FINE)).astype(np.float32)
    condition = rng.normal(size=(BATCH, *COARSE)).astype(np.float32)
    c_noise = np.linspace(-1, 0.5, BATCH, dtype=np.float32)
    inputs = tuple(map(jnp.asarray, (x, c_noise, condition)))
    params = random_params(network, *inputs)
    state = TrainState(jnp.int32(0), params, params, OPTIMIZER.init(params))

    forward = jax.jit(network.apply)

    @jax.jit
    @jax.grad
    def gradient(params):
        return jnp.mean((network.apply(params, *inputs) - clean) ** 2)

    torch = TorchPeer(network, params, inputs, clean)
    size = f"batch {BATCH}, {FINE[0]} x {FINE[1]}"
    yield Case(
        f"tiny: forward, {size}",
        lambda: forward(params, *inputs),
        available({"PyTorch": torch.forward}),
        same=_close,
    )
    yield Case(
        f"tiny: gradient, {size}",
        lambda: gradient(params),
        available({"PyTorch": torch.gradient}),
        same=_close_trees,
    )

    step = make_train_step(network, OPTIMIZER, NoiseSpec())
    batch, key = Batch(condition, clean), jax.random.key(0)

    def torch_step():
        peer_gradient, peer_update = torch.gradient(), _torch_update(params)
        return lambda: (peer_gradient(), peer_update())

    yield Case(
        f"tiny: whole step, {size}",
        lambda: step(state, key, batch),
        available({"PyTorch": torch_step}),
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


def _torch_update(params):
    """Return a call that clips, steps fused Adam and averages, all in place."""
    import torch

    leaves = [torch.from_numpy(np.array(leaf)) for leaf in jax.tree.leaves(params)]
    weights = [leaf.requires_grad_() for leaf in leaves]
    average = [weight.detach().clone() for weight in weights]
    slopes = [1e-2 * weight.detach() for weight in weights]
    optimizer = torch.optim.Adam(weights, lr=1e-4, fused=True)

    def run():
        for weight, slope in zip(weights, slopes, strict=True):
            weight.grad = slope.clone()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(average, [w.detach() for w in weights], 1e-3)

    return run
