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
from jaxtyping import Array, Inexact

from jradar.errors import parsing
from jradar.files import atomic_path
from jradar.model import Model, enhance
from jradar.radar import Radar

FORMAT = "jradar function 3"
MAX_HEADER_BYTES = 1 << 16
PLATFORMS = ("cpu", "cuda", "tpu")


class ExportedFunction(NamedTuple):
    """An exported function and the header of its file."""

    call: Callable[
        [int, Inexact[Array, "tx rx chirp sample"]],
        dict[str, Array],
    ]
    header: dict[str, Any]


def export_function(
    path: Path | str,
    radar: Radar,
    model: Model,
    *,
    platforms: Sequence[str] = ("cpu",),
    draws: int | None = None,
    steps: int | None = None,
) -> None:
    """Write `enhance` for one radar, with its calibration and the weights, as one file.

    `draws` and `steps` are those of `model.draw`. Raises ImportError without the extra
    `export`.
    """
    _check_extra()
    with atomic_path(path) as scratch:  # first: it refuses a folder at once
        drawing = {"draws": draws, "steps": steps}
        scratch.write_bytes(_serialised(radar, model, platforms, drawing))


def _serialised(radar, model, platforms, drawing) -> bytes:
    """Return the bytes of the file: the header's line and the function."""
    unknown = [name for name in platforms if name not in PLATFORMS]
    if unknown or not platforms:
        raise ValueError(f"platforms {platforms}, expected some of {PLATFORMS}")
    spec, card = radar.spec, model.card

    def function(seed, cube):
        key = jax.random.key(seed)
        cloud = enhance(key, cube, radar, model, **drawing)
        fields = cloud._asdict().items()
        return {name: value for name, value in fields if value is not None}

    shape = spec.cube_shape
    kind = jnp.float32 if spec.real_samples else jnp.complex64
    exported = jax.export.export(jax.jit(function), platforms=tuple(platforms))(
        jax.ShapeDtypeStruct((), jnp.uint32), jax.ShapeDtypeStruct(shape, kind)
    )
    content = bytes(exported.serialize())
    header = {
        "format": FORMAT,
        "sha256": hashlib.sha256(content).hexdigest(),
        "cube": shape,
        "radar": spec.name,
        "calibrated": radar.calibrated,
        "leakage": radar.leakage is not None,
        "platforms": tuple(platforms),
        "purpose": card.purpose,
        "trained_on": card.trained_on,
        "steps_seen": card.steps_seen,
        "sampling": {name: n for name, n in drawing.items() if n is not None},
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
        shape, kind = tuple(cube.shape), cube.dtype
        kinds = jnp.float32, jnp.complex64
        if (seed.shape, seed.dtype) != ((), jnp.uint32) or cube.dtype not in kinds:
            raise ValueError(f"it takes {seed} and {cube}")

    def call(seed, cube) -> Any:
        if cube.shape != shape:
            raise ValueError(f"cube has shape {cube.shape}, {path} expects {shape}")
        arguments = jnp.uint32(seed), jnp.asarray(cube, kind)
        with parsing(path, "an exported function for this machine"):
            return exported.call(*arguments)

    return ExportedFunction(call, header)


def _check_extra():
    """Raise ImportError naming the extra if flatbuffers is missing."""
    try:
        import flatbuffers  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "exporting needs the package flatbuffers: pip install 'jradar[export]'"
        ) from error
