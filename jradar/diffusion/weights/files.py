"""Files of parameters: `.safetensors` is read and written, `.npz` is read.

Kernels may be stored as whole numbers of a step, which takes a quarter of the bytes.
Pickles are never read; `experiments.convert_weights` converts published ones.
"""

import functools
from pathlib import Path
from typing import Any

import flax.traverse_util
import jax
import jax.numpy as jnp
import numpy as np
import safetensors.numpy

from jradar.diffusion.network import Network
from jradar.errors import parsing
from jradar.files import atomic_path, check_unpacked

MAX_FILE_BYTES = 4 << 30
MAX_PARTS = 32  # of the name of a parameter; each is a level of nested dictionaries
STEP = ":step"  # after a kernel's name: what its whole numbers count

State = dict[str, np.ndarray]


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
    # Converted by NumPy and placed in one call: else JAX compiles one for each shape.
    flat = {n: v.astype(np.float32) for n, v in read_state(path).items()}
    return flax.traverse_util.unflatten_dict(jax.device_put(flat), sep="/")


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
    check_unpacked(path, limit=MAX_FILE_BYTES)
    with np.load(path, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def misfit(
    params: Any,
    network: Network,
    *,
    image_shape: tuple[int, int, int],
    condition_shape: tuple[int, int, int],
) -> str:
    """Return how parameters do not fit a network, naming the first; "" if they do.

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
