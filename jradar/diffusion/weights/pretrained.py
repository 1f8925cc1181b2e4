"""Weights to start from.

`load_pretrained` reads, from the files of `files`,

- weights that were trained here: a model's, or those of its trunk alone;
- state dicts of NVIDIA's EDM: SongUNet with the DDPM++ settings, and DhariwalUNet.

Parts that a published network lacks start at zero, so the network begins as the
published one, applied to the means of the patches (`published`). Of a class-conditional
network, the answer without a label is kept. A network without `detail_channels` has a
different head, and ignores the published output layer.
"""

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import flax.traverse_util
import jax.numpy as jnp
import numpy as np
import safetensors

from jradar.diffusion.evidence import PARTS
from jradar.diffusion.network import Network, network_fields
from jradar.diffusion.predictions import PREDICTIONS
from jradar.diffusion.unet import UNet
from jradar.diffusion.weights.files import read_state
from jradar.diffusion.weights.published import (
    DROPPED,
    arranged,
    by_level,
    check_filters,
    check_groups,
    target_of,
    without_labels,
)
from jradar.errors import parsing

# Prefixes in files written here.
OWN, TOWER, EVIDENCE = "params/", "params/tower/", "params/evidence/"
HEADS = ("params/trunk/unfold/", "params/trunk/output/", "params/trunk/refine/")
# Convolutions of the channels of a condition.
CONDITIONED = ("params/tower/input/kernel", "params/evidence/conv0/kernel")
MEANS = 2  # outputs of every prediction: range and validity
# Fields of a network that the shapes of its parameters do not determine.
UNSHAPED = (
    "kind", "form", "stem", "head_channels", "noise_scale", "group_channels",
)  # fmt: skip
BEGUN_AS = {"evidence": "unet"}  # kinds that may start from another kind's weights
UNRECORDED = {"group_channels": 4}  # what networks had before files recorded it
# New parameters that must be zero for the network to be the published one.
ZERO = ("refine/", "angles/")


class Transfer(NamedTuple):
    """Names of loaded parameters, of new parameters, and of tensors left unused."""

    loaded: tuple[str, ...]
    new: tuple[str, ...]
    unused: tuple[str, ...]


def load_pretrained(
    path: Path | str,
    network: Network,
    params: Any,
) -> tuple[Any, Transfer]:
    """Return `params` of `network` with the weights of a file, and a report.

    Raises ValueError if file and network do not match.
    """
    state = read_state(path)
    if any(name.startswith(OWN) for name in state):
        _check_network(path, network)
        return _load_trained_here(path, state, params, network)
    if not isinstance(network, UNet):
        raise ValueError(f"{path} was not written by jradar: only a UNet can read it")
    with parsing(path, "a file of published weights"):
        return _load_published(path, state, params, network)


def _load_published(path, state, params, network):
    """`params` with the weights of EDM."""
    state = by_level(state)
    _check_published(path, state, network)
    check_filters(path, state)
    check_groups(path, state, network)
    state = without_labels(state)
    trunk = params["params"]["trunk"]
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(trunk, sep="/")
    loaded, unused = {}, []
    for name, tensor in state.items():
        target = target_of(name)
        if target not in flat or any(part in name for part in DROPPED):
            unused.append(name)
            continue
        shape = flat[target].shape
        tensor = arranged(np.asarray(tensor, np.float32), target, shape, network)
        _check_shape(path, name, tensor, flat[target])
        loaded[target] = jnp.asarray(tensor)
    new = [name for name in flat if name not in loaded]
    blocks = [n for n in unused if re.match(r"enc|dec", n)]
    spared = (*DROPPED, "aux_conv")  # unused by a network with another head
    surplus = [name for name in blocks if not any(part in name for part in spared)]
    _check_complete(path, [name for name in new if not _is_new(name)], surplus)
    start = {n: jnp.zeros_like(flat[n]) for n in new if n.startswith(ZERO)}
    start |= {n: jnp.zeros_like(flat[n]) for n in new if "_condition/" in n}
    trunk = flax.traverse_util.unflatten_dict(flat | start | loaded, sep="/")
    params = {**params, "params": {**params["params"], "trunk": trunk}}
    return params, Transfer(tuple(sorted(loaded)), tuple(new), tuple(unused))


def _load_trained_here(path, state, params, network):
    """`params` with the weights of a model of any prediction, or of a trunk alone."""
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(params, sep="/")
    new = [name for name in flat if name not in state]
    unused = [name for name in state if name not in flat]
    missing = set(new)
    for part in (TOWER, EVIDENCE):  # new as a whole, or not at all
        names = {name for name in flat if name.startswith(part)}
        missing -= names if names <= missing else set()
    _check_complete(path, sorted(missing), unused)
    loaded = {}
    for name, tensor in state.items():
        if name.startswith(HEADS):
            tensor = _with_outputs(tensor, flat[name].shape[-1], network.outputs)
        if name in CONDITIONED:
            tensor = _with_channels(tensor, flat[name].shape, network)
        _check_shape(path, name, tensor, flat[name])
        loaded[name] = jnp.asarray(tensor, flat[name].dtype)
    params = flax.traverse_util.unflatten_dict(flat | loaded, sep="/")
    return params, Transfer(tuple(sorted(loaded)), tuple(new), ())


def _with_outputs(tensor, size, outputs):
    """[..., pixel and output] with `outputs` a pixel: range and validity, then 0."""
    pixels = size // outputs
    known = [MEANS * each.outputs_per_channel for each in PREDICTIONS.values()]
    if tensor.shape[-1] == size or tensor.shape[-1] not in [n * pixels for n in known]:
        return tensor
    each = tensor.reshape(*tensor.shape[:-1], pixels, -1)[..., :MEANS]
    missing = [(0, 0)] * (each.ndim - 1) + [(0, outputs - each.shape[-1])]
    return np.pad(each, missing).reshape(*tensor.shape[:-1], size)


def _with_channels(tensor, shape, network):
    """A convolution of conditions, with zeros for channels that have become more."""
    parts = getattr(network, "parts", 0)
    more = shape[2] - tensor.shape[2]
    if parts <= PARTS or more <= 0:
        return tensor
    patch = math.prod(network.condition_stem)
    if tensor.shape[2] * parts == shape[2] * PARTS:  # of the tower's patches
        tensor = tensor.reshape(*tensor.shape[:2], patch, -1, tensor.shape[-1])
        missing = [(0, 0)] * 3 + [(0, more // patch), (0, 0)]
        return np.pad(tensor, missing).reshape(shape)
    known = more * PARTS // (parts - PARTS)  # of the evidence: features come after
    return np.insert(tensor, [known] * more, 0, axis=2)


def _unshaped(network):
    """The `UNSHAPED` fields of a network, with the types of JSON."""
    values = json.loads(json.dumps(network_fields(network)))
    return {name: values[name] for name in UNSHAPED if name in values}


def _check_network(path, network):
    """Refuse weights whose file records another kind of network."""
    if Path(path).suffix != ".safetensors":
        return
    with parsing(path, "a file of weights with its network"):
        with safetensors.safe_open(path, framework="numpy") as file:
            text = (file.metadata() or {}).get("network", "{}")
        found = dict(json.loads(text))
    for name, wanted in _unshaped(network).items():
        held = found.get(name, UNRECORDED.get(name, wanted) if found else wanted)
        if held != wanted and (name != "kind" or BEGUN_AS.get(wanted) != held):
            raise ValueError(
                f"{path} holds a network with {name} = {held}, expected {wanted}"
            )


def _check_published(path, state, network):
    """Refuse networks of another form or noise scale."""
    form = "ddpm++" if "dec.0_aux_conv.weight" in state else "adm"
    if form != network.form:
        raise ValueError(
            f"{path} has the form {form!r}, the network {network.form!r}: set its form"
        )
    if network.noise_scale != 1.0:
        raise ValueError(
            f"{path} needs noise_scale = 1.0, the network has {network.noise_scale}"
        )


def _check_shape(path, name, tensor, wanted):
    if tensor.shape != wanted.shape:
        raise ValueError(
            f"{path}: {name} has shape {tensor.shape}, the network needs "
            f"{wanted.shape}: compare channels and multipliers"
        )


def _is_new(name):
    """Whether no published network has this parameter of the trunk."""
    return name.startswith((*ZERO, "detail", "unfold/")) or "_condition/" in name


def _check_complete(path, missing, surplus):
    if missing or surplus:
        raise ValueError(
            f"{path} does not fit the network: {len(missing)} parameters missing "
            f"{missing[:2]}, {len(surplus)} too many {surplus[:2]}; compare blocks, "
            "multipliers and attention_levels"
        )
