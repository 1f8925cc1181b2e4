r"""Writes one file that turns an ADC cube into a dense cloud, without jradar.

The first line of the file is a JSON header. The rest is what `jax.export` serialises
for the function

    (seed, cube [tx, rx, chirp, sample])
        -> {"xyz": [point, 3], "valid", "velocity", "confidence": [point]}

The confidence is missing if the model has none.

The header holds a digest of the function, because a flipped bit in the weights would
otherwise go unnoticed. `loading` returns the lines that use the file where only JAX is
installed.
"""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

import jax
import jax.numpy as jnp

from jradar.files import atomic_path
from jradar.model import Model, enhance
from jradar.options.drawing import Drawing, given
from jradar.radar import Radar

FORMAT = "jradar function 4"
PLATFORMS = ("cpu", "cuda", "tpu")


def loading(path: Path | str) -> list[str]:
    """Return lines of Python that make a cloud of a `cube` with an exported file."""
    return [
        "import hashlib, json, jax, numpy",
        f"header, function = open({str(path)!r}, 'rb').read().split(b'\\n', 1)",
        "assert hashlib.sha256(function).hexdigest() == json.loads(header)['sha256']",
        "call = jax.export.deserialize(bytearray(function)).call",
        "cloud = call(numpy.uint32(0), cube)  # a seed, and numpy's samples",
    ]


def export_function(
    path: Path | str,
    radar: Radar,
    model: Model,
    *,
    platforms: Sequence[str] = ("cpu",),
    **drawing: Unpack[Drawing],
) -> None:
    """Write `enhance` for one radar, with its calibration and the weights, as one file.

    The options of drawing are those of `draw`.
    """
    unknown = [name for name in platforms if name not in PLATFORMS]
    if unknown or not platforms:
        raise ValueError(f"platforms {platforms}, expected some of {PLATFORMS}")
    spec, card = radar.spec, model.card

    def function(seed, cube):
        key = jax.random.key(seed)
        cloud = enhance(key, cube, radar, model, **drawing)
        fields = cloud._asdict().items()
        return {name: value for name, value in fields if value is not None}

    with atomic_path(path) as scratch:  # first: it refuses a folder at once
        kind = jnp.float32 if spec.real_samples else jnp.complex64
        exported = jax.export.export(jax.jit(function), platforms=tuple(platforms))(
            jax.ShapeDtypeStruct((), jnp.uint32),
            jax.ShapeDtypeStruct(spec.cube_shape, kind),
        )
        content = bytes(exported.serialize())
        header = {
            "format": FORMAT,
            "sha256": hashlib.sha256(content).hexdigest(),
            "cube": spec.cube_shape,
            "radar": spec.name,
            "calibrated": radar.calibrated,
            "leakage": radar.leakage is not None,
            "platforms": tuple(platforms),
            "purpose": card.purpose,
            "trained_on": card.trained_on,
            "steps_seen": card.steps_seen,
            "drawing": given(drawing),
        }
        scratch.write_bytes(json.dumps(header).encode() + b"\n" + content)
