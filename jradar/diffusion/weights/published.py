"""EDM's published networks with this network's names and axes.

Every tensor gets EDM's name with the level in place of the image size, for example
`enc.1_block0.conv0.weight`, and then this network's order of axes. RGB becomes range:
input kernels are summed over the colours, as for a grey image, and output kernels are
averaged. With a stem, a kernel is divided evenly among the pixels of a patch.
"""

import math
import re
from typing import Any

import numpy as np

from jradar.diffusion.unet import UNet
from jradar.diffusion.weights.files import State

FULL_GROUPS = 128  # channels from which norms have 32 groups
FEWEST = 4  # channels of a group
LAYERS = {"weight": "kernel", "bias": "bias"}
# Constants, and parameters used only for augmented training.
DROPPED = ("resample_filter", "map_augment", "augment")


def by_level(state: State) -> State:
    """Return EDM's tensors with levels in their names: enc.32x32_ becomes enc.1_."""
    state = {name.removeprefix("model."): tensor for name, tensor in state.items()}
    first = re.compile(r"enc\.(\d+)x\d+_conv\.weight")
    sizes = [int(match[1]) for match in map(first.fullmatch, state) if match]
    if len(sizes) != 1:
        raise ValueError(
            "no first convolution found: expected weights of jradar or EDM"
        )
    if any("aux_residual" in name or name == "map_noise.freqs" for name in state):
        raise ValueError("found NCSN++ (ve), expected DDPM++ (vp) or Dhariwal's")

    def level(match):
        return f"{match[1]}.{round(math.log2(sizes[0] / int(match[2])))}_"

    return {re.sub(r"^(enc|dec)\.(\d+)x\d+_", level, n): t for n, t in state.items()}


def without_labels(state: State) -> State:
    """Return a class-conditional network's tensors as those of one without classes.

    EDM's networks treat a missing label as a label of zeros. Of that, the bias of
    `map_label` remains, and is added to the bias of the next layer.
    """
    folded = dict(state)
    bias = folded.pop("map_label.bias", None)
    if bias is not None:
        weight = np.asarray(folded["map_layer0.weight"])
        folded["map_layer0.bias"] = folded["map_layer0.bias"] + weight @ bias
    return folded


def check_filters(path: Any, state: State) -> None:
    """Refuse a file that does not resample by means of 2 x 2 pixels."""
    for name, taps in state.items():
        if name.endswith("resample_filter") and not np.allclose(taps, 0.25, atol=1e-4):
            shares = np.round(np.sum(taps, -1).ravel(), 3).tolist()
            raise ValueError(
                f"{path}: {name} has taps in the shares {shares}, expected [0.5, 0.5]"
            )


def check_groups(path: Any, state: State, network: UNet) -> None:
    """Refuse a network whose norms would have other groups than the published ones."""
    norms = [t for n, t in state.items() if re.search(r"norm\d?\.weight$", n)]
    narrow = min((len(tensor) for tensor in norms), default=FULL_GROUPS)
    if narrow < FULL_GROUPS and network.group_channels != FEWEST:
        raise ValueError(
            f"{path} has norms of {narrow} channels in groups of {FEWEST} or more, the "
            f"network has groups of {network.group_channels} or more: set its "
            f"group_channels = {FEWEST}"
        )


def target_of(name: str) -> str:
    """Return the path in the trunk of a tensor like enc.1_block0.conv0.weight."""
    name = re.sub(r"^(enc|dec)\.(\d+)_", r"\1\2_", name)
    *place, kind = name.split(".")
    place = "/".join(place)
    place = {
        "enc0_conv": "stem",
        "map_layer0": "embed0",
        "map_layer1": "embed1",
        "dec0_aux_norm": "norm",
        "out_norm": "norm",
        "dec0_aux_conv": "output",
        "out_conv": "output",
    }.get(place, place)
    normalises = place.split("/")[-1].startswith("norm")
    return f"{place}/{'scale' if normalises and kind == 'weight' else LAYERS.get(kind)}"


def arranged(
    tensor: np.ndarray, target: str, shape: tuple[int, ...], network: UNet
) -> np.ndarray:
    """Return a tensor with this network's order of axes and channels, as `shape`."""
    layer = target.split("/")[-2]
    if layer == "qkv":
        tensor = _heads_first(tensor, network)
    if layer in ("qkv", "proj"):
        tensor = tensor.reshape(tensor.shape[:2])  # from a 1 x 1 convolution
    if tensor.ndim == 4:
        tensor = tensor.transpose(2, 3, 1, 0)
    elif tensor.ndim == 2:
        tensor = tensor.T
    patch = math.prod(network.stem)
    if target == "stem/kernel":
        grey = tensor[:, :, :3].sum(2, keepdims=True) / patch
        other = np.zeros_like(grey).repeat(shape[2] // patch - 1, 2)
        return np.tile(np.concatenate([grey, other], 2), (1, 1, patch, 1))
    if target.startswith("output/"):
        grey = tensor[..., :3].mean(-1, keepdims=True)
        other = np.zeros_like(grey).repeat(network.outputs - 1, -1)
        grey = np.concatenate([grey, other], -1)
        return np.tile(grey, (1,) * (tensor.ndim - 1) + (patch,))
    return tensor


def _heads_first(tensor, network):
    """Query, key and value channels in the order [head, query key value, channel]."""
    channels = len(tensor) // 3
    song = network.form == "ddpm++"
    heads = 1 if song else max(1, channels // network.head_channels)
    parts = tensor.reshape(heads, channels // heads, 3, *tensor.shape[1:])
    return np.swapaxes(parts, 1, 2).reshape(tensor.shape)
