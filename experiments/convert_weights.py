r"""Published image diffusion models to files that `load_pretrained` reads.

    python -m experiments.convert_weights edm-ffhq-64x64-uncond-vp.pkl ffhq.safetensors
    python -m experiments.convert_weights edm_imagenet64_ema.pt imagenet.safetensors

Needs PyTorch in the environment that runs it; jradar itself never imports this script.
`.pt` files are plain state dicts. NVIDIA's `.pkl` files hold the source of their
network, which unpickling in the usual way would execute: here the source is dropped,
and of each module only parameters, buffers and modules are kept. Globals other than
PyTorch's way of storing tensors are refused, or stand in as objects that do nothing.

Mind the licences: NVIDIA's weights are CC BY-NC-SA 4.0, also for what is derived from
them; those of OpenAI's consistency models are MIT.
"""

import io
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from jradar.files import atomic_path

HARMLESS = ("torch", "numpy", "dnnlib", "collections", "training", "torch_utils")


def main(arguments: list[str]) -> int:
    """Convert one file; returns the exit code."""
    if len(arguments) != 2:
        print(__doc__, file=sys.stderr)
        return 2
    source, target = map(Path, arguments)
    try:
        state = convert(source)
    except (ValueError, ImportError) as error:
        print(f"{source}: {error}", file=sys.stderr)
        return 4
    with atomic_path(target) as scratch:
        safetensors.numpy.save_file(state, scratch)
    print(f"{target}: {len(state)} tensors, {sum(t.size for t in state.values()):,}")
    return 0


def convert(source: Path) -> dict[str, np.ndarray]:
    """The tensors of a `.pt` or `.pkl` file in float32, by their names."""
    try:
        import torch
    except ImportError as error:
        raise ImportError("needs PyTorch: pip install torch") from error
    if source.suffix == ".pkl":
        with source.open("rb") as file:
            state = _tensors(_Unpickler(file).load())
    else:
        try:
            state = torch.load(source, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError as error:
            raise ValueError(f"is more than a state dict: {error}") from error
    state = {k: v for k, v in state.items() if isinstance(v, torch.Tensor)}
    if not state:
        raise ValueError("holds no tensors")
    return {name: t.detach().float().contiguous().numpy() for name, t in state.items()}


class _Inert:
    """Stands for an object that is not needed: takes everything, does nothing."""

    def __init__(self, *_, **__):
        pass

    def __setstate__(self, state):
        pass

    def __setitem__(self, key, value):
        pass

    def append(self, item):
        """Like a list."""

    def extend(self, items):
        """Like a list."""


class _Module(dict):
    """State of a persistent object, without its source."""


class _Container(_Module):
    """A list or dictionary of modules."""

    def __setstate__(self, state):
        self.update(state)


class _Unpickler(pickle.Unpickler):
    """Reads tensors and the tree of modules; runs nothing that the file brings."""

    def find_class(self, module: str, name: str) -> Any:
        import torch

        known = {
            "_reconstruct_persistent_obj": lambda meta: _Module(meta["state"]),
            "_rebuild_parameter": lambda data, *_: data,
            "_rebuild_tensor_v2": torch._utils._rebuild_tensor_v2,
            "_load_from_bytes": lambda content: torch.load(
                io.BytesIO(content), map_location="cpu", weights_only=True
            ),
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
        raise ValueError(f"asks for {module}.{name}: refused")


def _tensors(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Parameters and buffers of the averaged network, by module path."""
    if isinstance(tree, dict) and "ema" in tree:
        tree = tree["ema"]
    if not isinstance(tree, _Module):
        raise ValueError("has no network under `ema`")
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
