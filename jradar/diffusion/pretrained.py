"""Files of weights: reading and writing parameters, and weights to start from.

`load_pretrained` reads, from `.npz` or `.safetensors`,

- weights that were trained here: a model's, or those of its trunk alone;
- state dicts of NVIDIA's EDM: SongUNet with the DDPM++ settings, and DhariwalUNet;
- state dicts of OpenAI's ADM with continuous noise levels, as in consistency models.

Pickles are never read; `experiments.convert_weights` converts published ones. Parts
that a published network lacks start at zero, so the network begins as the published
one, applied to the means of the patches (`published`). Of a class-conditional network,
EDM's answer without a label is kept, or OpenAI's for the mean of all labels. A network
without `detail_channels` has a different head, and ignores the published output layer.
"""

import functools
import json
import re
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import flax.traverse_util
import jax
import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy

from jradar.diffusion.network import Network, network_fields
from jradar.diffusion.predictions import PREDICTIONS
from jradar.diffusion.published import (
    DROPPED,
    State,
    arranged,
    by_level,
    check_filters,
    check_groups,
    from_adm,
    target_of,
    without_labels,
)
from jradar.diffusion.unet import UNet
from jradar.errors import parsing
from jradar.files import atomic_path

MAX_FILE_BYTES = 4 << 30
MAX_PARTS = 32  # of the name of a parameter; each is a level of nested dictionaries
ATTENTION_ORDERS = ("legacy", "new")
OWN, TOWER = "params/", "params/tower/"  # prefixes in files written here
HEADS = ("params/trunk/unfold/", "params/trunk/output/", "params/trunk/refine/")
STEP = ":step"  # after a kernel's name: what its whole numbers count
MEANS = 2  # outputs of every prediction: range and validity
# Fields of a network that the shapes of its parameters do not determine.
UNSHAPED = (
    "kind", "form", "stem", "head_channels", "noise_scale", "group_channels",
    "resample_filter",
)  # fmt: skip
# What networks had before files recorded these fields.
UNRECORDED = {"group_channels": 4, "resample_filter": [1, 1]}
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
    *,
    attention_order: str | None = None,
) -> tuple[Any, Transfer]:
    """Return `params` of `network` with the weights of a file, and a report.

    `attention_order` is the order of query, key and value channels in an ADM, which its
    file does not record: "new" for models trained with use_new_attention_order or flash
    attention, otherwise "legacy". Raises ValueError if file and network do not match.
    """
    state = read_state(path)
    if any(name.startswith(OWN) for name in state):
        _check_network(path, network)
        return _load_trained_here(path, state, params, network)
    if not isinstance(network, UNet):
        raise ValueError(f"{path} was not written by jradar: only a UNet can read it")
    with parsing(path, "a file of published weights"):
        return _load_published(path, state, params, network, attention_order)


def _load_published(path, state, params, network, attention_order):
    """`params` with the weights of EDM or of an ADM."""
    if "input_blocks.0.0.weight" in state:
        if attention_order not in ATTENTION_ORDERS:
            raise ValueError(
                f"{path} is an ADM: {attention_order=}, expected one of "
                f"{ATTENTION_ORDERS}"
            )
        kind, state = attention_order, from_adm(state, network)
    else:
        kind, state = "edm", by_level(state)
    _check_published(path, state, kind, network)
    check_filters(path, state, network)
    check_groups(path, state, kind, network)
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
        tensor = arranged(np.asarray(tensor, np.float32), target, shape, network, kind)
        _check_shape(path, name, tensor, flat[target])
        loaded[target] = jnp.asarray(tensor)
    new = [name for name in flat if name not in loaded]
    blocks = [n for n in unused if re.match(r"enc|dec|input_|output_|middle_", n)]
    spared = (*DROPPED, "aux_conv")  # unused by a network with another head
    surplus = [name for name in blocks if not any(part in name for part in spared)]
    _check_complete(path, [name for name in new if not _is_new(name)], surplus)
    start = {n: jnp.zeros_like(flat[n]) for n in new if n.startswith(ZERO)}
    start |= {n: jnp.zeros_like(flat[n]) for n in new if "_condition/" in n}
    trunk = flax.traverse_util.unflatten_dict(flat | start | loaded, sep="/")
    params = {**params, "params": {**params["params"], "trunk": trunk}}
    return params, Transfer(tuple(sorted(loaded)), tuple(new), tuple(unused))


def write_params(
    path: Path | str,
    params: Any,
    *,
    metadata: dict[str, str] | None = None,
    dtype: Any = np.float16,
) -> None:
    """Write nested parameters as safetensors, named by their paths.

    With the `dtype` int8, kernels are rounded to 255 steps for each output, and stored
    with these steps; other parameters are stored as float16.
    """
    flat = flax.traverse_util.flatten_dict(params, sep="/")
    if dtype == np.int8:
        arrays = _rounded(flat)
    else:
        arrays = {name: np.asarray(value, dtype) for name, value in flat.items()}
    content = safetensors.numpy.save(arrays, metadata)
    with atomic_path(path) as scratch:
        scratch.write_bytes(content)


def _rounded(flat: dict[str, Any]) -> State:
    """Kernels as int8 with the step of each output, all else as float16."""
    arrays = {}
    for name, value in flat.items():
        value = np.asarray(value, np.float32)
        if value.ndim < 2:
            arrays[name] = value.astype(np.float16)
            continue
        most = np.abs(value).max(tuple(range(value.ndim - 1)))
        step = np.maximum(most, 1e-12) / 127
        arrays[name] = np.round(value / step).astype(np.int8)
        arrays[name + STEP] = step.astype(np.float32)
    return arrays


def _whole(arrays: State) -> State:
    """Arrays that were stored as whole numbers of a step, as float32."""
    steps = {n.removesuffix(STEP): v for n, v in arrays.items() if n.endswith(STEP)}
    return {
        name: array.astype(np.float32) * steps[name] if name in steps else array
        for name, array in arrays.items()
        if not name.endswith(STEP)
    }


def read_params(path: Path | str) -> Any:
    """Return the nested parameters of a file of `write_params`, as float32.

    Raises FileNotFoundError for a missing file, ValueError for a damaged one.
    """
    flat = {n: jnp.asarray(v, jnp.float32) for n, v in read_state(path).items()}
    return flax.traverse_util.unflatten_dict(flat, sep="/")


def misfit(
    params: Any,
    network: Network,
    *,
    image_shape: tuple[int, int, int],
    condition_shape: tuple[int, int, int],
) -> str:
    """Return in what parameters do not fit a network, naming the first; "" if they do.

    Shapes of images and conditions are [row, column, channel].
    """
    found = parameter_shapes(params)
    expected = _expected_shapes(network, image_shape, condition_shape)
    wrong = sorted(n for n in found | expected if found.get(n) != expected.get(n))
    if not wrong:
        return ""
    first = wrong[0]
    return (
        f"{first} is {found.get(first, 'missing')}, expected "
        f"{expected.get(first, 'no such parameter')} ({len(wrong)} differ)"
    )


def parameter_shapes(params: Any) -> dict[str, tuple[int, ...]]:
    """Return the shapes of nested parameters by their path."""
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(params, sep="/")
    return {name: leaf.shape for name, leaf in flat.items()}


@functools.lru_cache(8)
def _expected_shapes(network, image_shape, condition_shape):
    """Shapes of the network's parameters by their path."""
    shapes = (1, *image_shape), (1,), (1, *condition_shape)
    inputs = (jax.ShapeDtypeStruct(shape, jnp.float32) for shape in shapes)
    return parameter_shapes(jax.eval_shape(network.init, jax.random.key(0), *inputs))


def read_state(path: Path | str) -> State:
    """Return the arrays of an `.npz` or `.safetensors` file by name.

    Raises FileNotFoundError for a missing file, ValueError for a damaged one and for
    values that are not finite.
    """
    path = Path(path)
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(f"{path} is larger than {MAX_FILE_BYTES:,} bytes")
    if path.suffix not in (".safetensors", ".npz"):
        raise ValueError(
            f"{path}: expected .npz or .safetensors; convert pickles with "
            "experiments/convert_weights.py"
        )
    with parsing(path, f"a {path.suffix} file of weights"):
        state = (
            _read_npz(path)
            if path.suffix == ".npz"
            else safetensors.numpy.load_file(path)
        )
        for name, array in state.items():
            if (parts := name.count("/") + 1) > MAX_PARTS:
                raise ValueError(f"a name of {parts:,} parts, at most {MAX_PARTS}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} holds values that are not finite")
        return _whole(state)


def _read_npz(path):
    """The arrays of an .npz file."""
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > MAX_FILE_BYTES:
        raise ValueError(f"it unpacks to {size:,} bytes")
    with np.load(path, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _load_trained_here(path, state, params, network):
    """`params` with the weights of a model, or of a trunk alone.

    Every prediction's first two outputs are range and validity. A network of another
    prediction keeps these, and its other outputs start at 0.
    """
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(params, sep="/")
    new = [name for name in flat if name not in state]
    unused = [name for name in state if name not in flat]
    tower = [name for name in flat if name.startswith(TOWER)]
    _check_complete(path, [] if new == tower else new, unused)
    loaded = {}
    for name, tensor in state.items():
        if name.startswith(HEADS):
            tensor = _with_outputs(tensor, flat[name].shape[-1], network.outputs)
        _check_shape(path, name, tensor, flat[name])
        loaded[name] = jnp.asarray(tensor, flat[name].dtype)
    params = flax.traverse_util.unflatten_dict(flat | loaded, sep="/")
    return params, Transfer(tuple(sorted(loaded)), tuple(new), ())


def _with_outputs(tensor, size, outputs):
    """[..., pixel and output] with `outputs` for each pixel: the first two, then 0."""
    pixels = size // outputs
    known = [MEANS * each.outputs_per_channel for each in PREDICTIONS.values()]
    if tensor.shape[-1] == size or tensor.shape[-1] not in [n * pixels for n in known]:
        return tensor
    each = tensor.reshape(*tensor.shape[:-1], pixels, -1)[..., :MEANS]
    missing = [(0, 0)] * (each.ndim - 1) + [(0, outputs - each.shape[-1])]
    return np.pad(each, missing).reshape(*tensor.shape[:-1], size)


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
        if held != wanted:
            raise ValueError(
                f"{path} holds a network with {name} = {held}, expected {wanted}"
            )


def _check_published(path, state, kind, network):
    """Refuse networks of another form or noise scale, or with discrete time steps."""
    form = "ddpm++" if "dec.0_aux_conv.weight" in state else "adm"
    if form != network.form:
        raise ValueError(
            f"{path} has the form {form!r}, the network {network.form!r}: set its form"
        )
    scale = 1.0 if kind == "edm" else 1000.0
    if network.noise_scale != scale:
        raise ValueError(
            f"{path} needs noise_scale = {scale}, the network has {network.noise_scale}"
        )
    colours = state["enc.0_conv.weight"].shape[1]
    outputs = len(state.get("out_conv.weight", ()))
    if outputs == 2 * colours:
        raise ValueError(
            f"{path} has {outputs} outputs for {colours} colours: a model of "
            "guided-diffusion, which embeds 1000 discrete steps instead of noise "
            "levels; expected weights of EDM or of a consistency model"
        )


def _check_shape(path, name, tensor, wanted):
    """Refuse a tensor of another shape than the parameter."""
    if tensor.shape != wanted.shape:
        raise ValueError(
            f"{path}: {name} has shape {tensor.shape}, the network needs "
            f"{wanted.shape}: compare channels and multipliers"
        )


def _is_new(name):
    """Whether no published network has this parameter of the trunk."""
    return name.startswith((*ZERO, "detail", "unfold/")) or "_condition/" in name


def _check_complete(path, missing, surplus):
    """Refuse a file that lacks parameters or has surplus blocks."""
    if missing or surplus:
        raise ValueError(
            f"{path} does not fit the network: {len(missing)} parameters missing "
            f"{missing[:2]}, {len(surplus)} too many {surplus[:2]}; compare blocks, "
            "multipliers and attention_levels"
        )
