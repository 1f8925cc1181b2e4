"""How fast is sampling in one scan, compared with a Python loop over jitted steps?

The network `tiny` draws one image of the paper's size, with 18 steps of Heun's method
(35 evaluations). The loop calls the same steps, compiled one by one. Both results must
agree before they are timed.

One pass evaluates the network once, compiled as `jradar enhance` does; its peer is the
same network in PyTorch.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.bench_training import TorchPeer
from benchmarks.harness import Call, Case, available, random_params
from jradar.diffusion import (
    HEUN,
    NoiseSpec,
    build_network,
    conditional_denoiser,
    heun_step,
    precondition,
)
from jradar.model import compiler_options

NETWORK, NOISE = build_network(preset="tiny"), NoiseSpec()
SHAPE, CONDITION, STEPS = (1, 128, 512, 2), (1, 64, 64, 24), 18


def cases() -> Iterator[Case]:
    """Yield Heun's method, and one pass."""
    rng = np.random.default_rng(0)
    condition = jnp.asarray(rng.normal(size=CONDITION), jnp.float32)
    start = jnp.asarray(rng.normal(size=SHAPE), jnp.float32) * NOISE.sigma_max
    params = random_params(NETWORK, start, jnp.zeros(1), condition)
    sigmas = HEUN.levels(STEPS, NOISE)

    @jax.jit
    def sampled(params, condition, start):
        denoise = conditional_denoiser(NETWORK, params, NOISE)(condition)
        return HEUN.solve(denoise, start, sigmas)

    yield Case(
        f"heun, {STEPS} steps, {SHAPE[1]} x {SHAPE[2]}",
        lambda: sampled(params, condition, start),
        {"Python loop over jitted steps": _loop(params, condition, start, sigmas)},
        same=_close,
    )
    yield _one_pass(start, condition)


def _one_pass(start, condition) -> Case:
    """The network of one pass, beside PyTorch."""
    network = build_network(preset="tiny", outputs=14)
    inputs = jnp.zeros_like(start), jnp.zeros(1), condition
    params = random_params(network, *inputs)
    forward = jax.jit(network.apply, compiler_options=compiler_options())
    torch = TorchPeer(network, params, inputs, np.zeros(0, np.float32))
    return Case(
        f"network of one pass, {SHAPE[1]} x {SHAPE[2]}",
        lambda: forward(params, *inputs),
        available({"PyTorch": torch.forward}),
        same=_close,
    )


def _close(ours, peer):
    """Return whether images agree in float32 after all steps."""
    ours, peer = np.asarray(ours), np.asarray(peer)
    return np.allclose(ours, peer, rtol=1e-3, atol=1e-3 * np.abs(peer).max())


def _given(params, features):
    """Return the denoiser for the features of a condition."""
    return precondition(
        lambda x, level: NETWORK.apply(params, x, level, features, method="decode"),
        NOISE,
    )


@jax.jit
def _encode(params, condition):
    return NETWORK.apply(params, condition, method="encode")


@jax.jit
def _step(params, features, x, sigma, after):
    return heun_step(_given(params, features), x, sigma, after)


@jax.jit
def _last(params, features, x, sigma):
    return _given(params, features)(x, sigma)


def _loop(params, condition, start, sigmas) -> Call:
    """Return a call that takes Heun's steps one by one and returns the image."""
    levels = jnp.asarray(sigmas, jnp.float32)

    def run():
        features, x = _encode(params, condition), start
        for i in range(len(sigmas) - 1):
            x = _step(params, features, x, levels[i], levels[i + 1])
        return _last(params, features, x, levels[-1])

    return run
