r"""Convert published image diffusion models to files that `load_pretrained` reads.

    python -m experiments.convert_weights edm-ffhq-64x64-uncond-vp.pkl ffhq.safetensors
    python -m experiments.convert_weights edm_imagenet64_ema.pt imagenet.safetensors
    python -m experiments.convert_weights terrain_consistency_unet_difficulty100.onnx \
        terrain.safetensors

`.pt` files are plain state dicts, and need PyTorch as `.pkl` files do. NVIDIA's `.pkl`
files contain the source of their network, which ordinary unpickling would execute. Here
it is dropped, and only the parameters, buffers and submodules of each module are kept.
Apart from PyTorch's storage of tensors, globals are refused or replaced by inert
objects. The `.onnx` file of adaptive-terrain-diffusion (PyPI) needs onnx: an ADM for
height maps, which takes a difficulty from 0 to 1 in the place of a label.

Mind the licences: NVIDIA's weights, and everything derived from them, are CC BY-NC-SA
4.0; OpenAI's consistency models and adaptive-terrain-diffusion are MIT.
"""

import io
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from experiments.command import exit_code_of
from jradar.errors import parsing
from jradar.files import atomic_path

HARMLESS = ("torch", "numpy", "dnnlib", "collections", "training", "torch_utils")
# Of an ADM: the layer that follows each norm, and the norm's name.
NORMS = {
    "in_layers.2": "in_layers.0",
    "out_layers.3": "out_layers.0",
    "qkv": "norm",
    "out.2": "out.0",
}
LABELS = np.linspace(0.0, 1.0, 100, dtype=np.float32)  # difficulties of height maps


def main(arguments: list[str]) -> int:
    """Convert one file and return the exit code."""
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    source, target = map(Path, arguments)
    return exit_code_of(lambda: write_converted(source, target))


def write_converted(source: Path, target: Path) -> None:
    """Write the tensors of `source` to `target` as safetensors."""
    with parsing(source, "a file of weights"):
        state = convert(source)
    with atomic_path(target) as scratch:
        safetensors.numpy.save_file(state, scratch)
    print(f"{target}: {len(state)} tensors, {sum(t.size for t in state.values()):,}")


def convert(source: Path) -> dict[str, np.ndarray]:
    """Return the tensors of a `.pt`, `.pkl` or `.onnx` file in float32, by name."""
    if not source.is_file():
        raise FileNotFoundError(f"no such file: {source}")
    if source.suffix == ".onnx":
        return _of_onnx(source)
    try:
        import torch
    except ImportError as error:
        raise ImportError("PyTorch is missing: pip install torch") from error
    if source.suffix == ".pkl":
        with source.open("rb") as file:
            state = _tensors(_Unpickler(file).load())
    else:
        state = _load_plain(torch, source)
    if not isinstance(state, dict):
        raise ValueError("it contains no state dict")
    state = {k: v for k, v in state.items() if isinstance(v, torch.Tensor)}
    if not state:
        raise ValueError("it contains no tensors")
    return {name: t.detach().float().contiguous().numpy() for name, t in state.items()}


def _of_onnx(source: Path) -> dict[str, np.ndarray]:
    """Return the tensors of an ADM that PyTorch exported, with the names of its norms.

    The graph names convolutions and linear layers, but not norms. A norm is an
    InstanceNormalization, the factors of a Mul and the terms of an Add, and belongs to
    the convolution that follows.
    """
    try:
        import onnx
    except ImportError as error:
        raise ImportError("onnx is missing: pip install onnx") from error
    graph = onnx.load(source, load_external_data=False).graph
    tensors = {t.name: onnx.numpy_helper.to_array(t) for t in graph.initializer}
    named = {n: t for n, t in tensors.items() if n.startswith("network.")}
    state = {n.removeprefix("network."): t.astype(np.float32) for n, t in named.items()}
    norm: dict[str, np.ndarray] = {}
    normalised = ""  # the value that becomes a norm's output, step by step
    for node in graph.node:
        known = [tensors[name] for name in node.input if name in tensors]
        if node.op_type == "InstanceNormalization":
            normalised = node.output[0]
        elif node.op_type in ("Reshape", "Mul", "Add") and normalised in node.input:
            normalised = node.output[0]
            if node.op_type != "Reshape":
                kind = "weight" if node.op_type == "Mul" else "bias"
                norm[kind] = known[0].astype(np.float32).ravel()
            if node.op_type == "Add":
                normalised = ""
        elif node.op_type == "Conv" and node.input[1] in named:
            place = node.input[1].removeprefix("network.").removesuffix(".weight")
            for layer, its_norm in NORMS.items():
                if place.endswith(layer):
                    place = place.removesuffix(layer) + its_norm
                    state |= {f"{place}.{k}": tensor for k, tensor in norm.items()}
                    break
    if "out.0.weight" not in state:
        raise ValueError("it contains no ADM whose tensors are named network.*")
    if (first := state.pop("label_emb.0.weight", None)) is not None:
        h = LABELS[:, None] @ first.T + state.pop("label_emb.0.bias")
        h = h / (1 + np.exp(-h)) @ state.pop("label_emb.2.weight").T
        state["label_emb.weight"] = h + state.pop("label_emb.2.bias")
    return state


def _load_plain(torch: Any, source: Path | io.BytesIO) -> Any:
    """Return the content of a `.pt` file of plain tensors, or refuse it."""
    try:
        return torch.load(source, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:  # whose message advises to run the file's code
        raise ValueError(
            "it contains more than a state dict of tensors, or is cut short: objects "
            "of other kinds may run code and are refused"
        ) from None


class _Inert:
    """A stand-in for objects that are not needed: accepts everything, does nothing."""

    def __init__(self, *_, **__):
        pass

    def __setstate__(self, state):
        pass

    def __setitem__(self, key, value):
        pass

    def append(self, item):
        """Ignore the item."""

    def extend(self, items):
        """Ignore the items."""


class _Module(dict):
    """The state of a persistent object, without its source."""


class _Container(_Module):
    """A list or dictionary of modules."""

    def __setstate__(self, state):
        self.update(state)


class _Unpickler(pickle.Unpickler):
    """Read tensors and the tree of modules; run no code of the file."""

    def find_class(self, module: str, name: str) -> Any:
        import torch

        known = {
            "_reconstruct_persistent_obj": lambda meta: _Module(meta["state"]),
            "_rebuild_parameter": lambda data, *_: data,
            "_rebuild_tensor_v2": torch._utils._rebuild_tensor_v2,
            "_load_from_bytes": lambda content: _load_plain(torch, io.BytesIO(content)),
            "OrderedDict": dict,
            "EasyDict": dict,
        }
        root = module.split(".")[0]
        if root in HARMLESS and name in known:
            return known[name]
        if module == "torch.nn.modules.container":
            return _Container
        if root in HARMLESS or (module, name) == ("builtins", "set"):
            return _Inert
        raise ValueError(f"it asks for {module}.{name}: refused")


def _tensors(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Return parameters and buffers of the averaged network, by module path."""
    if isinstance(tree, dict) and "ema" in tree:
        tree = tree["ema"]
    if not isinstance(tree, _Module):
        raise ValueError("it contains no network under `ema`")
    found = {}
    for group in ("_parameters", "_buffers"):
        items = tree.get(group, {}).items()
        found |= {f"{prefix}{k}": value for k, value in items if value is not None}
    for name, module in tree.get("_modules", {}).items():
        if isinstance(module, _Module):
            found |= _tensors(module, f"{prefix}{name}.")
    return found


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
