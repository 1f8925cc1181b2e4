"""Published image diffusion models as the start of this network.

`load_pretrained` reads state dicts of NVIDIA's EDM (SongUNet with the DDPM++ settings,
DhariwalUNet) and of OpenAI's ADM from `.npz` or `.safetensors`; the scripts that come
with the experiments make these from the published pickles, which are never read here.

The networks agree but for names and orders. Every tensor gets EDM's name with the level
for the pixels, `enc.1_block0.conv0.weight`, then this network's order of axes. RGB goes
to range: input kernels are summed over the colours, as for a grey image, and output
kernels averaged; behind a stem each pixel of a patch gets its share. What is new starts
at zero, so that the network first is the published one on the patches' means.
"""

import math
import re
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import flax.traverse_util
import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy

from jradar.diffusion.unet import UNet

MAX_FILE_BYTES = 4 << 30
ATTENTION_ORDERS = ("legacy", "new")
LAYERS = {"weight": "kernel", "bias": "bias"}
# Not parameters, or for augmented training only.
DROPPED = ("resample_filter", "map_augment", "augment")
# New parameters that must be zero for the network to be the published one.
ZERO = ("refine/", "angles/")

State = dict[str, np.ndarray]


class Transfer(NamedTuple):
    """Names of the parameters that were loaded, those left new, tensors not used."""

    loaded: tuple[str, ...]
    new: tuple[str, ...]
    unused: tuple[str, ...]


def load_pretrained(
    path: Path | str,
    network: UNet,
    params: Any,
    *,
    attention_order: str = "legacy",
) -> tuple[Any, Transfer]:
    """`params` of `network` with a published model's weights, and a report.

    `attention_order` is that of an ADM's query, key and value channels: "new" for
    models trained with use_new_attention_order or flash attention. Raises ValueError
    where the file and the network do not fit.
    """
    if attention_order not in ATTENTION_ORDERS:
        raise ValueError(f"{attention_order=}, expected one of {ATTENTION_ORDERS}")
    state = read_state(path)
    if "input_blocks.0.0.weight" in state:
        kind, state = attention_order, _from_adm(state, network)
    else:
        kind, state = "edm", _by_level(state)
    form = "ddpm++" if "dec.0_aux_conv.weight" in state else "adm"
    if form != network.form:
        raise ValueError(f"{path} is {form}, the network {network.form}: set its form")
    scale = 1.0 if kind == "edm" else 1000.0
    if network.noise_scale != scale:
        raise ValueError(
            f"{path} needs noise_scale = {scale}, the network has {network.noise_scale}"
        )
    trunk = params["params"]["trunk"]
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(trunk, sep="/")
    loaded, unused = {}, []
    for name, tensor in state.items():
        target = _target(name)
        if target not in flat or any(part in name for part in DROPPED):
            unused.append(name)
            continue
        tensor = _arranged(np.asarray(tensor, np.float32), target, network, kind)
        if tensor.shape != flat[target].shape:
            raise ValueError(
                f"{path}: {name} makes {tensor.shape}, the network has "
                f"{flat[target].shape}: is its size (channels, multipliers) another?"
            )
        loaded[target] = jnp.asarray(tensor)
    new = [name for name in flat if name not in loaded]
    _check_complete(path, [name for name in new if not _is_new(name)], unused)
    start = {n: jnp.zeros_like(flat[n]) for n in new if n.startswith(ZERO)}
    start |= {n: jnp.zeros_like(flat[n]) for n in new if "_condition/" in n}
    trunk = flax.traverse_util.unflatten_dict(flat | start | loaded, sep="/")
    params = {**params, "params": {**params["params"], "trunk": trunk}}
    return params, Transfer(tuple(sorted(loaded)), tuple(new), tuple(unused))


def read_state(path: Path | str) -> State:
    """Arrays of an `.npz` or `.safetensors` file by name."""
    path = Path(path)
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path} is larger than {MAX_FILE_BYTES:,} bytes")
    try:
        if path.suffix == ".safetensors":
            return safetensors.numpy.load_file(path)
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                size = sum(member.file_size for member in archive.infolist())
            if size > MAX_FILE_BYTES:
                raise ValueError(f"it unpacks to {size:,} bytes")
            with np.load(path, allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
    except (safetensors.SafetensorError, zipfile.BadZipFile, ValueError) as error:
        raise ValueError(f"{path} is not usable: {error}") from error
    raise ValueError(
        f"{path}, expected .npz or .safetensors: convert pickles with "
        "experiments/convert_weights.py"
    )


def _by_level(state: State) -> State:
    """EDM's tensors with the level in place of the pixels: enc.32x32_ to enc.1_."""
    state = {name.removeprefix("model."): tensor for name, tensor in state.items()}
    first = re.compile(r"enc\.(\d+)x\d+_conv\.weight")
    sizes = [int(match[1]) for match in map(first.fullmatch, state) if match]
    if len(sizes) != 1:
        raise ValueError("neither a state dict of EDM nor of ADM: no first convolution")
    if any("aux_residual" in name or name == "map_noise.freqs" for name in state):
        raise ValueError("an NCSN++ (ve) state dict: only DDPM++ (vp) and ADM fit")

    def level(match):
        return f"{match[1]}.{round(math.log2(sizes[0] / int(match[2])))}_"

    return {re.sub(r"^(enc|dec)\.(\d+)x\d+_", level, n): t for n, t in state.items()}


def _from_adm(state: State, network: UNet) -> State:
    """OpenAI's tensors under EDM's names, by walking both in the order of layers."""
    last = len(network.multipliers) - 1
    places = {"time_embed.0": "map_layer0", "time_embed.2": "map_layer1"}
    places |= {"input_blocks.0.0": "enc.0_conv"}
    places |= {"out.0": "out_norm", "out.2": "out_conv"}
    number = 1
    for level in range(last + 1):
        if level:
            places[f"input_blocks.{number}.0"] = f"enc.{level}_down"
            number += 1
        for i in range(network.blocks):
            places[f"input_blocks.{number}.0"] = f"enc.{level}_block{i}"
            places[f"input_blocks.{number}.1"] = f"enc.{level}_block{i}"
            number += 1
    places["middle_block.0"] = places["middle_block.1"] = f"dec.{last}_in0"
    places["middle_block.2"] = f"dec.{last}_in1"
    number = 0
    for level in reversed(range(last + 1)):
        for i in range(network.blocks + 1):
            block = f"output_blocks.{number}"
            places[f"{block}.0"] = f"dec.{level}_block{i}"
            up = 2 if f"{block}.1.qkv.weight" in state else 1
            if up == 2:
                places[f"{block}.1"] = f"dec.{level}_block{i}"
            if level and i == network.blocks:
                places[f"{block}.{up}"] = f"dec.{level - 1}_up"
            number += 1
    layers = {
        "in_layers.0": "norm0",
        "in_layers.2": "conv0",
        "emb_layers.1": "affine",
        "out_layers.0": "norm1",
        "out_layers.3": "conv1",
        "skip_connection": "skip",
        "norm": "norm2",
        "qkv": "qkv",
        "proj_out": "proj",
    }
    renamed = {}
    for name, tensor in state.items():
        match = re.match(r"((?:input|output)_blocks\.\d+\.\d+|\w+\.\d+)\.(.+)", name)
        place = places.get(match[1]) if match else None
        if match is None or place is None:
            renamed[name] = tensor
            continue
        layer, _, kind = match[2].rpartition(".")
        layer = f".{layers.get(layer, layer)}" if layer else ""
        renamed[f"{place}{layer}.{kind}"] = tensor
    return renamed


def _target(name: str) -> str:
    """The path of a tensor in the trunk: enc.1_block0.conv0.weight and its like."""
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


def _arranged(tensor, target, network, kind):
    """A tensor in this network's order of axes and channels."""
    layer = target.split("/")[-2]
    if layer == "qkv":
        tensor = _heads_first(tensor, network, kind)
    if layer in ("qkv", "proj"):
        tensor = tensor.reshape(tensor.shape[:2])  # a convolution of 1 x 1, or of 1
    if tensor.ndim == 4:
        tensor = tensor.transpose(2, 3, 1, 0)
    elif tensor.ndim == 2:
        tensor = tensor.T
    patch = math.prod(network.stem)
    if target == "stem/kernel":
        grey = tensor[:, :, :3].sum(2, keepdims=True) / patch
        other = np.zeros_like(grey).repeat(network.outputs - 1, 2)
        return np.tile(np.concatenate([grey, other], 2), (1, 1, patch, 1))
    if target.startswith("output/"):
        grey = tensor[..., :3].mean(-1, keepdims=True)
        other = np.zeros_like(grey).repeat(network.outputs - 1, -1)
        grey = np.concatenate([grey, other], -1)
        return np.tile(grey, (1,) * (tensor.ndim - 1) + (patch,))
    return tensor


def _heads_first(tensor, network, kind):
    """Channels of query, key and value as [head, query key value, channel]."""
    channels = len(tensor) // 3
    song = network.form == "ddpm++"
    heads = 1 if song else max(1, channels // network.head_channels)
    if kind == "legacy":
        return tensor
    split, order = {
        "edm": ((heads, channels // heads, 3), (0, 2, 1)),
        "new": ((3, heads, channels // heads), (1, 0, 2)),
    }[kind]
    rest = tensor.shape[1:]
    parts = tensor.reshape(*split, *rest)
    return parts.transpose(*order, *range(3, 3 + len(rest))).reshape(tensor.shape)


def _is_new(name):
    """Whether a parameter of the trunk has no counterpart in published networks."""
    return name.startswith((*ZERO, "detail", "unfold/")) or "_condition/" in name


def _check_complete(path, missing, unused):
    """Refuse a file that lacks parameters of the trunk, or has blocks too many."""
    blocks = [n for n in unused if re.match(r"enc|dec|input_|output_|middle_", n)]
    surplus = [name for name in blocks if not any(part in name for part in DROPPED)]
    if missing or surplus:
        raise ValueError(
            f"{path} does not fit the network: {len(missing)} parameters missing "
            f"{missing[:2]}, {len(surplus)} too many {surplus[:2]}; compare blocks, "
            "multipliers and attention_levels"
        )
