"""The network "tiny" in PyTorch, a function of the same parameters.

Weights are named by their path, such as `trunk/stem/kernel`. Weights and images have
their channels first.
"""

from typing import Any

import jax
import numpy as np

from jradar.diffusion import UNet
from jradar.diffusion.blocks import angle_features


def to_flax(weight: Any) -> np.ndarray:
    """Return a weight with its axes in Flax's order."""
    weight = weight.detach()
    return np.asarray(weight.movedim((0, 1), (-1, -2)) if weight.ndim > 1 else weight)


def to_torch(params: Any, inputs: Any) -> tuple[dict[str, Any], tuple[Any, ...]]:
    """Return parameters by their path, and inputs, channels first."""
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


def network(unet: UNet, weights: Any, x: Any, c_noise: Any, condition: Any) -> Any:
    """Return the output of `unet` with the weights of `to_torch`, channels first."""
    import torch
    from torch.nn import functional

    def dense(name, h):
        return functional.linear(h, weights[f"{name}/kernel"], weights[f"{name}/bias"])

    def conv(name, h, stride=1):
        kernel = weights[f"{name}/kernel"]
        if stride == 2:  # Flax's "same" pads an odd pixel at the end
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

    def fold(h, stem):
        high, wide = stem
        h = h.unflatten(3, (-1, wide)).unflatten(2, (-1, high))
        return h.permute(0, 3, 5, 1, 2, 4).flatten(1, 3)

    def unfold(h):
        h = h.unflatten(1, (*unet.stem, -1)).permute(0, 3, 4, 1, 5, 2)
        return h.flatten(4, 5).flatten(2, 3)

    def angles(name, h):
        features = torch.from_numpy(angle_features(*h.shape[2:])).float()
        return dense(name, features).movedim(-1, 0)

    def attention(name, h):
        batch, channels, _, _ = h.shape
        heads = max(1, channels // unet.head_channels)
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
    h = conv("tower/input", fold(condition, unet.condition_stem))
    for level in range(len(unet.multipliers)):
        if level:
            h = conv(f"tower/down{level}", functional.silu(h), 2)
        inner = functional.silu(norm(f"tower/GroupNorm_{level}", h))
        h = h + conv(f"tower/conv{level}", inner)
        features.append(h)

    half = unet.channels // 2
    frequencies = torch.from_numpy((1 / 10000) ** (np.arange(half) / half)).float()
    phase = torch.outer(c_noise, frequencies)
    embedding = torch.cat([phase.cos(), phase.sin()], -1)
    for layer in ("embed0", "embed1"):
        embedding = functional.silu(dense(f"trunk/{layer}", embedding))

    patches = fold(x, unet.stem)
    h = conv("trunk/stem", patches) + angles("trunk/angles", patches)
    skips = []
    for level in range(len(unet.multipliers)):
        h = block(f"enc{level}_down", h, "down") if level else h
        for feature in features:
            if feature.shape[2:] == h.shape[2:]:
                h = h + pointwise(f"trunk/enc{level}_condition", feature)
        skips.append(h)
        for i in range(unet.blocks):
            h = block(f"enc{level}_block{i}", h)
            skips.append(h)
    last = len(unet.multipliers) - 1
    h = block(f"dec{last}_in1", block(f"dec{last}_in0", h))
    for level in range(last, -1, -1):
        h = block(f"dec{level}_up", h, "up") if level < last else h
        for i in range(unet.blocks + 1):
            h = block(f"dec{level}_block{i}", torch.cat([h, skips.pop()], 1))
    h = functional.silu(norm("trunk/norm", h))
    return unfold(pointwise("trunk/unfold", h))
