"""Where does a training step's time go, and how long does PyTorch take for the same?

The network `tiny` at half the paper's image sizes, in float32. The peer is the same
network as a plain function of the same parameters, channels first; forward pass and
gradient must be ours before they are timed. The optimiser with the moving average is
compared with PyTorch's fused Adam.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import optax

from benchmarks.harness import Case, available
from jradar.diffusion import PRESETS, NoiseSpec, UNet
from jradar.diffusion.blocks import angle_features
from jradar.training import Batch, create_state, make_train_step

BATCH, FINE, COARSE = 2, (64, 256, 2), (32, 32, 8)
NETWORK = UNet(**PRESETS["tiny"])
OPTIMIZER = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(1e-4))


def cases() -> Iterator[Case]:
    """Forward pass, gradient, optimiser with moving average, and the whole step."""
    rng = np.random.default_rng(0)
    x, clean = rng.normal(size=(2, BATCH, *FINE)).astype(np.float32)
    condition = rng.normal(size=(BATCH, *COARSE)).astype(np.float32)
    c_noise = np.linspace(-1, 0.5, BATCH, dtype=np.float32)
    state = create_state(
        jax.random.key(0, impl="rbg"),
        NETWORK,
        OPTIMIZER,
        image_shape=FINE,
        condition_shape=COARSE,
    )
    # Layers that start at zero would hide everything behind them.
    leaves, tree = jax.tree.flatten(state.params)
    leaves = [p + 0.02 * rng.normal(size=p.shape).astype(np.float32) for p in leaves]
    params = jax.tree.unflatten(tree, leaves)
    inputs = tuple(map(jnp.asarray, (x, c_noise, condition)))

    forward = jax.jit(NETWORK.apply)

    def error(params):
        return jnp.mean((NETWORK.apply(params, *inputs) - clean) ** 2)

    gradient = jax.jit(jax.grad(error))
    size = f"batch {BATCH}, {FINE[0]} x {FINE[1]}"
    yield Case(
        f"network forward, {size}",
        lambda: forward(params, *inputs),
        dict(available({"PyTorch": lambda: _torch_forward(params, inputs)})),
        same=_close,
    )
    yield Case(
        f"network gradient, {size}",
        lambda: gradient(params),
        dict(available({"PyTorch": lambda: _torch_gradient(params, inputs, clean)})),
        same=_close_trees,
    )

    @jax.jit
    def update(state, gradient):
        updates, opt_state = OPTIMIZER.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        ema_params = optax.incremental_update(params, state.ema_params, 1e-3)
        return params, ema_params, opt_state

    slopes = jax.block_until_ready(gradient(params))
    count = sum(leaf.size for leaf in leaves)
    yield Case(
        f"clip, Adam and moving average, {count / 1e6:.1f}M parameters",
        lambda: update(state, slopes),
        dict(available({"PyTorch": lambda: _torch_update(leaves, slopes)})),
    )
    step = make_train_step(NETWORK, OPTIMIZER, NoiseSpec())
    batch, key = Batch(condition, clean), jax.random.key(0)
    yield Case(
        f"whole step, {size}",
        lambda: step(state, key, batch),
        dict(
            available(
                {"PyTorch": lambda: _torch_step(params, inputs, clean, leaves, slopes)}
            )
        ),
    )


def _close(ours, peer):
    """Whether outputs agree in float32."""
    ours = np.asarray(ours)
    return np.allclose(ours, peer, rtol=1e-3, atol=1e-4 * np.abs(ours).max())


def _close_trees(ours, peer):
    """Whether gradients agree, leaf by leaf, in float32."""
    ours = {
        "/".join(str(k.key) for k in path[1:]): np.asarray(leaf)
        for path, leaf in jax.tree_util.tree_leaves_with_path(ours)
    }
    largest = max(np.abs(leaf).max() for leaf in ours.values())
    return ours.keys() == peer.keys() and all(
        np.allclose(leaf, _to_flax(peer[name]), rtol=1e-2, atol=1e-4 * largest)
        for name, leaf in ours.items()
    )


def _to_flax(weight):
    """A weight with its axes as Flax has them."""
    weight = weight.detach()
    return np.asarray(weight.movedim((0, 1), (-1, -2)) if weight.ndim > 1 else weight)


def _to_torch(params, inputs):
    """Parameters by their path, and inputs, channels first."""
    import torch

    weights = {}
    for path, leaf in jax.tree_util.tree_leaves_with_path(params):
        weight = torch.from_numpy(np.array(leaf))
        weight = weight.movedim((-1, -2), (0, 1)) if weight.ndim > 1 else weight
        name = "/".join(str(k.key) for k in path[1:])
        weights[name] = weight.contiguous().requires_grad_()
    x, c_noise, condition = (torch.from_numpy(np.array(a)) for a in inputs)
    first = (x.movedim(-1, 1), c_noise, condition.movedim(-1, 1))
    return weights, tuple(a.contiguous() for a in first)


def _torch_forward(params, inputs):
    """The output, channels last."""
    import torch

    weights, inputs = _to_torch(params, inputs)

    def run():
        with torch.no_grad():
            return _network(weights, *inputs).movedim(1, -1).numpy()

    return run


def _torch_gradient(params, inputs, clean):
    """The gradient of the mean squared error, by name."""
    import torch

    weights, inputs = _to_torch(params, inputs)
    target = torch.from_numpy(clean).movedim(-1, 1).contiguous()
    names = [*weights]

    def run():
        loss = ((_network(weights, *inputs) - target) ** 2).mean()
        slopes = torch.autograd.grad(loss, [weights[name] for name in names])
        return dict(zip(names, slopes, strict=True))

    return run


def _torch_update(leaves, slopes):
    """Clip, fused Adam and moving average in place."""
    import torch

    weights = [torch.from_numpy(np.array(leaf)).requires_grad_() for leaf in leaves]
    average = [weight.detach().clone() for weight in weights]
    given = [torch.from_numpy(np.array(s)) for s in jax.tree.leaves(slopes)]
    optimizer = torch.optim.Adam(weights, lr=1e-4, fused=True)

    def run():
        for weight, slope in zip(weights, given, strict=True):
            weight.grad = slope.clone()
        torch.nn.utils.clip_grad_norm_(weights, 1.0)
        optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(average, [w.detach() for w in weights], 1e-3)

    return run


def _torch_step(params, inputs, clean, leaves, slopes):
    """Gradient and update, one after the other."""
    gradient = _torch_gradient(params, inputs, clean)
    update = _torch_update(leaves, slopes)

    def run():
        gradient()
        update()

    return run


def _network(weights, x, c_noise, condition):
    """`NETWORK` in PyTorch, channels first."""
    import torch
    from torch.nn import functional

    def dense(name, h):
        return functional.linear(h, weights[f"{name}/kernel"], weights[f"{name}/bias"])

    def conv(name, h, stride=1):
        kernel = weights[f"{name}/kernel"]
        if stride == 2:  # "same" as Flax has it: the odd pixel at the end
            h = functional.pad(h, (0, 1, 0, 1))
        padding = "same" if stride == 1 else 0
        return functional.conv2d(h, kernel, weights[f"{name}/bias"], stride, padding)

    def pointwise(name, h):
        kernel = weights[f"{name}/kernel"][:, :, None, None]
        return functional.conv2d(h, kernel, weights[f"{name}/bias"])

    def norm(name, h):
        groups = min(32, max(1, h.shape[1] // 4))
        scale, bias = weights[f"{name}/scale"], weights[f"{name}/bias"]
        return functional.group_norm(h, groups, scale, bias, 1e-5)

    def resample(h, way):
        if way == "down":
            return functional.avg_pool2d(h, 2)
        return functional.interpolate(h, scale_factor=2) if way == "up" else h

    def fold(h):
        high, wide = NETWORK.stem
        h = h.unflatten(3, (-1, wide)).unflatten(2, (-1, high))
        return h.permute(0, 3, 5, 1, 2, 4).flatten(1, 3)

    def unfold(h):
        h = h.unflatten(1, (*NETWORK.stem, -1)).permute(0, 3, 4, 1, 5, 2)
        return h.flatten(4, 5).flatten(2, 3)

    def angles(name, h):
        features = torch.from_numpy(angle_features(*h.shape[2:])).float()
        return dense(name, features).movedim(-1, 0)

    def attention(name, h):
        batch, channels, _, _ = h.shape
        heads = max(1, channels // NETWORK.head_channels)
        flat = norm(f"{name}/norm2", h).flatten(2).transpose(1, 2)
        qkv = dense(f"{name}/qkv", flat).reshape(batch, -1, heads, 3, channels // heads)
        q, k, v = qkv.permute(3, 0, 2, 1, 4)
        mixed = functional.scaled_dot_product_attention(q, k, v).transpose(1, 2)
        mixed = dense(f"{name}/proj", mixed.reshape(batch, -1, channels))
        return mixed.transpose(1, 2).reshape(h.shape)

    def block(name, h, way=""):
        name = f"trunk/{name}"
        skip = resample(h, way)
        h = resample(functional.silu(norm(f"{name}/norm0", h)), way)
        h = conv(f"{name}/conv0", h)
        affine = dense(f"{name}/affine", embedding)[:, :, None, None]
        scale, shift = affine.chunk(2, 1)
        h = functional.silu(norm(f"{name}/norm1", h) * (1 + scale) + shift)
        h = conv(f"{name}/conv1", h)
        if f"{name}/skip/kernel" in weights:
            skip = conv(f"{name}/skip", skip)
        h = skip + h
        return h + attention(name, h) if f"{name}/qkv/kernel" in weights else h

    features = []
    h = conv("tower/input", condition)
    for level in range(len(NETWORK.multipliers)):
        if level:
            h = conv(f"tower/down{level}", functional.silu(h), 2)
        inner = functional.silu(norm(f"tower/GroupNorm_{level}", h))
        h = h + conv(f"tower/conv{level}", inner)
        features.append(h)

    half = NETWORK.channels // 2
    frequencies = torch.from_numpy((1 / 10000) ** (np.arange(half) / half)).float()
    phase = torch.outer(c_noise, frequencies)
    embedding = torch.cat([phase.cos(), phase.sin()], -1)
    for layer in ("embed0", "embed1"):
        embedding = functional.silu(dense(f"trunk/{layer}", embedding))

    detail = conv("trunk/detail", x) + angles("trunk/detail_angles", x)
    level = dense("trunk/detail_affine", embedding)[:, :, None, None]
    scale, shift = level.chunk(2, 1)
    detail = detail * (1 + scale) + shift
    patches = fold(x)
    h = conv("trunk/stem", patches) + angles("trunk/angles", patches)
    skips = []
    for level in range(len(NETWORK.multipliers)):
        h = block(f"enc{level}_down", h, "down") if level else h
        for feature in features:
            if feature.shape[2:] == h.shape[2:]:
                h = h + pointwise(f"trunk/enc{level}_condition", feature)
        skips.append(h)
        for i in range(NETWORK.blocks):
            h = block(f"enc{level}_block{i}", h)
            skips.append(h)
    last = len(NETWORK.multipliers) - 1
    h = block(f"dec{last}_in1", block(f"dec{last}_in0", h))
    for level in range(last, -1, -1):
        h = block(f"dec{level}_up", h, "up") if level < last else h
        for i in range(NETWORK.blocks + 1):
            h = block(f"dec{level}_block{i}", torch.cat([h, skips.pop()], 1))
    h = functional.silu(norm("trunk/norm", h))
    fine = torch.cat([unfold(pointwise("trunk/unfold", h)), detail], 1)
    fine = conv("trunk/refine", functional.silu(fine))
    return unfold(conv("trunk/output", h)) + fine
