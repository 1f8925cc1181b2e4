r"""Convert published image diffusion models to files that `load_pretrained` reads.

    python -m experiments.convert_weights edm-ffhq-64x64-uncond-vp.pkl ffhq.safetensors

NVIDIA's `.pkl` files need PyTorch. They contain the source of their network, which
ordinary unpickling would execute. Here it is dropped, and only the parameters, buffers
and submodules of each module are kept. Apart from PyTorch's storage of tensors, globals
are refused or replaced by inert objects.

Mind the licence: NVIDIA's weights, and everything derived from them, are CC BY-NC-SA
4.0.
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
    """Return the tensors of a `.pkl` file in float32, by name."""
    if not source.is_file():
        raise FileNotFoundError(f"no such file: {source}")
    try:
        import torch
    except ImportError as error:
        raise ImportError("PyTorch is missing: pip install torch") from error
    with source.open("rb") as file:
        state = _tensors(_Unpickler(file).load())
    state = {k: v for k, v in state.items() if isinstance(v, torch.Tensor)}
    if not state:
        raise ValueError("it contains no tensors")
    return {name: t.detach().float().contiguous().numpy() for name, t in state.items()}


def _load_plain(torch: Any, source: io.BytesIO) -> Any:
    """Return plain tensors of a pickle, or refuse it."""
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
