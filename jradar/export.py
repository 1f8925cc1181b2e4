r"""The whole function from ADC cube to dense cloud, with weights, in one file.

The file runs without jradar's source: its first line is a JSON header, what follows is
`jax.export`'s serialised form of

    (seed, cube [tx, rx, chirp, sample]) -> (xyz [point, 3], valid [point])

The header holds the digest of all that follows, since a flipped bit in the weights
would otherwise go unnoticed. Where only JAX is installed:

    header, function = open("model.jradar", "rb").read().split(b"\n", 1)
    assert hashlib.sha256(function).hexdigest() == json.loads(header)["sha256"]
    xyz, valid = jax.export.deserialize(bytearray(function)).call(seed, cube)
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from jradar.bundle import Bundle
from jradar.diffusion import conditional_denoiser
from jradar.files import atomic_path
from jradar.pipeline import enhance

FORMAT = "jradar function 1"
MAX_HEADER_BYTES = 1 << 16
PLATFORMS = ("cpu", "cuda", "tpu")


class ExportedFunction(NamedTuple):
    """A loaded file: the function, and its header."""

    call: Callable[
        [int, Complex[Array, "tx rx chirp sample"]],
        tuple[Float[Array, "point 3"], Bool[Array, " point"]],
    ]
    header: dict[str, Any]


def export_function(
    path: Path | str,
    bundle: Bundle,
    *,
    coupling: Complex[np.ndarray, "tx rx half_range"] | None = None,
    platforms: Sequence[str] = ("cpu",),
    **sampling: Any,
) -> None:
    """Write `enhance` with the bundle's weights; `sampling` are its options.

    The radar and its frame's size are the bundle's. `coupling` is that of the unit the
    file is for, as `read_coupling` reads it, and is kept in the file. Raises ValueError
    for the coupling of another array, ImportError without the extra `export`.
    """
    _check_extra()
    unknown = [name for name in platforms if name not in PLATFORMS]
    if unknown or not platforms:
        raise ValueError(f"platforms {platforms}, expected some of {PLATFORMS}")
    params, spec = bundle
    radar, points = spec.radar, spec.points
    if coupling is not None:
        points = {**points, "coupling": jnp.asarray(coupling, jnp.complex64)}

    def function(seed, cube):
        cloud = enhance(
            jax.random.key(seed),
            cube,
            conditional_denoiser(spec.network, params, spec.noise),
            radar=radar,
            coarse=spec.coarse,
            fine=spec.fine,
            num_slices=spec.num_slices,
            points=points,
            noise=spec.noise,
            codec=spec.codec,
            **{**spec.sampling, **sampling},
        )
        return cloud.xyz, cloud.valid

    shape = (radar.num_tx, radar.num_rx, radar.num_chirps, radar.num_samples)
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
        "sampling": {name: str(value) for name, value in sampling.items()},
    }
    with atomic_path(path) as scratch:
        scratch.write_bytes(json.dumps(header).encode() + b"\n" + content)


def load_function(path: Path | str) -> ExportedFunction:
    """Read what `export_function` wrote. Raises ValueError for a damaged file."""
    _check_extra()
    path = Path(path)
    with path.open("rb") as file:
        line = file.readline(MAX_HEADER_BYTES)
        try:
            header = json.loads(line)
            digest, found = header["sha256"], header["format"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path} is not an exported function: {error!r}"
            ) from error
        if found != FORMAT:
            raise ValueError(f"{path} has format {found!r}, expected {FORMAT!r}")
        content = file.read()
    if hashlib.sha256(content).hexdigest() != digest:
        raise ValueError(f"{path} does not match its digest: is it damaged?")
    exported = jax.export.deserialize(bytearray(content))

    def call(seed, cube) -> Any:
        shape = tuple(header["cube"])
        if cube.shape != shape:
            raise ValueError(f"a cube of {cube.shape}, {path} was made for {shape}")
        return exported.call(jnp.uint32(seed), jnp.asarray(cube, jnp.complex64))

    return ExportedFunction(call, header)


def _check_extra():
    """Name the extra where the package that serialises is missing."""
    try:
        import flatbuffers  # noqa: F401
    except ImportError as error:
        raise ImportError(
            "exporting needs the package flatbuffers: pip install 'jradar[export]'"
        ) from error
