r"""One file that turns an ADC cube into a dense cloud and runs without jradar.

The first line of the file is a JSON header. The rest is what `jax.export` serialises
for the function

    (seed, cube [tx, rx, chirp, sample])
        -> {"xyz": [point, 3], "valid", "velocity", "confidence": [point]}

without the confidence where the model has none.

The header holds a digest of the function, because a flipped bit in the weights would
otherwise go unnoticed. To use the file where only JAX is installed:

    header, function = open("model.jradar", "rb").read().split(b"\n", 1)
    assert hashlib.sha256(function).hexdigest() == json.loads(header)["sha256"]
    cloud = jax.export.deserialize(bytearray(function)).call(seed, cube)
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jradar.errors import parsing
from jradar.files import atomic_path
from jradar.model import Model, enhance

FORMAT = "jradar function 2"
MAX_HEADER_BYTES = 1 << 16
PLATFORMS = ("cpu", "cuda", "tpu")


class ExportedFunction(NamedTuple):
    """An exported function and the header of its file."""

    call: Callable[
        [int, Complex[Array, "tx rx chirp sample"]],
        dict[str, Array],
    ]
    header: dict[str, Any]


def export_function(
    path: Path | str,
    model: Model,
    *,
    coupling: Complex[np.ndarray, "tx rx half_range"] | None = None,
    platforms: Sequence[str] = ("cpu",),
    **drawing: Any,
) -> None:
    """Write `enhance` with a model's weights as one file.

    The radar and the size of its frame are the model's. `coupling` is the calibration
    of one unit (`read_coupling`); it becomes part of the file. `drawing` are options of
    `model.draw`. Raises ValueError for the coupling of another array, ImportError
    without the extra `export`.
    """
    _check_extra()
    with atomic_path(path) as scratch:  # first: it refuses a folder at once
        scratch.write_bytes(_serialised(model, coupling, platforms, drawing))


def _serialised(model, coupling, platforms, drawing) -> bytes:
    """Return the bytes of the file: the header's line and the function."""
    unknown = [name for name in platforms if name not in PLATFORMS]
    if unknown or not platforms:
        raise ValueError(f"platforms {platforms}, expected some of {PLATFORMS}")
    spec, radar = model.spec, model.spec.radar
    leakage = None if coupling is None else jnp.asarray(coupling, jnp.complex64)

    def function(seed, cube):
        key = jax.random.key(seed)
        cloud = enhance(key, cube, model, coupling=leakage, **drawing)
        fields = cloud._asdict().items()
        return {name: value for name, value in fields if value is not None}

    shape = radar.cube_shape
    exported = jax.export.export(jax.jit(function), platforms=tuple(platforms))(
        jax.ShapeDtypeStruct((), jnp.uint32), jax.ShapeDtypeStruct(shape, jnp.complex64)
    )
    content = bytes(exported.serialize())
    header = {
        "format": FORMAT,
        "sha256": hashlib.sha256(content).hexdigest(),
        "cube": shape,
        "radar": radar.name,
        "coupling": coupling is not None,
        "platforms": tuple(platforms),
        "purpose": spec.purpose,
        "trained_on": spec.trained_on,
        "steps_seen": spec.steps_seen,
        "sampling": {name: _printed(value) for name, value in drawing.items()},
    }
    return json.dumps(header).encode() + b"\n" + content


def load_function(path: Path | str) -> ExportedFunction:
    """Load a file of `export_function`. Raises ValueError for a damaged file."""
    _check_extra()
    path = Path(path)
    with path.open("rb") as file:
        line = file.readline(MAX_HEADER_BYTES)
        with parsing(path, "an exported function"):
            header = json.loads(line)
            digest, found = header["sha256"], header["format"]
        if found != FORMAT:
            raise ValueError(f"{path} has format {found!r}, expected {FORMAT!r}")
        content = file.read()
    if hashlib.sha256(content).hexdigest() != digest:
        raise ValueError(f"{path} does not match its digest: export again")
    with parsing(path, "an exported function"):
        exported = jax.export.deserialize(bytearray(content))
        seed, cube = exported.in_avals
        shape = tuple(cube.shape)
        if (seed.shape, seed.dtype, cube.dtype) != ((), jnp.uint32, jnp.complex64):
            raise ValueError(f"it takes {seed} and {cube}")

    def call(seed, cube) -> Any:
        if cube.shape != shape:
            raise ValueError(f"cube has shape {cube.shape}, {path} expects {shape}")
        arguments = jnp.uint32(seed), jnp.asarray(cube, jnp.complex64)
        with parsing(path, "an exported function for this machine"):
            return exported.call(*arguments)

    return ExportedFunction(call, header)


def _printed(value: Any) -> Any:
    """An option of `draw` as JSON takes it: a solver by its name."""
    return getattr(value, "name", value)


def _check_extra():
    """Raise ImportError naming the extra if flatbuffers is missing."""
    try:
        import flatbuffers  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "exporting needs the package flatbuffers: pip install 'jradar[export]'"
        ) from error
