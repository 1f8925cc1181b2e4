"""The model of maps: a network that gives each voxel's probability, and its files.

weights.safetensors    the network's parameters, named by path
map_model.json         network, size of voxels and images, confidence, origin
"""

import dataclasses
import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from jradar.diffusion import (
    Network,
    conditional_denoiser,
    misfit,
    network_fields,
    network_from_fields,
    read_params,
    write_params,
)
from jradar.errors import ModelError
from jradar.fields import typed_fields
from jradar.files import atomic_folder, read_json
from jradar.mapping.columns import EXTRA, MapSpec
from jradar.mapping.methods import METHODS
from jradar.model.folder import SHIPPED
from jradar.range_image import IDENTITY, ConfidenceTable, frequency

FORMAT = 2
MARKER, WEIGHTS = "map_model.json", "weights.safetensors"
DRAWS = 8  # of a model of diffusion


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("params", "confidence"),
    meta_fields=("network", "spec", "method"),
    drop_fields=("purpose", "trained_on"),
)
@dataclasses.dataclass(frozen=True, repr=False)
class MapModel:
    """A trained network of maps: a pytree whose leaves are parameters and table."""

    params: Any
    network: Network
    spec: MapSpec
    method: str = "occupancy"  # a key of METHODS
    confidence: ConfidenceTable = IDENTITY
    purpose: str = ""
    trained_on: str = ""

    def calibrated_by(self, table: ConfidenceTable) -> "MapModel":
        """Return the model with another table of confidence."""
        return dataclasses.replace(self, confidence=table)

    def __repr__(self) -> str:
        """One line: size of the network and of a voxel, and what it was trained on."""
        size = sum(np.size(leaf) for leaf in jax.tree.leaves(self.params)) / 1e6
        return (
            f"MapModel({size:.3g} million parameters, {self.spec.voxel_m:g} m, "
            f"trained on {self.trained_on or 'unknown data'})"
        )


@functools.partial(jax.jit, static_argnames="draws")
def voxel_frequencies(
    condition: Float[Array, "x y channel"], model: MapModel, *, draws: int = DRAWS
) -> Float[Array, "x y height"]:
    """Return how often a voxel of such a score is occupied, for each.

    `draws` is of models of diffusion alone.
    """
    method = METHODS[model.method]
    denoise = conditional_denoiser(model.network, model.params, method.noise)
    score = method.scores(
        jax.random.key(0),
        denoise(condition[None]),
        (1, *condition.shape[:-1], condition.shape[-1] - EXTRA),
        method.noise,
        draws=draws,
    )[0]
    return frequency(score, model.confidence)


def save_map_model(
    folder: Path | str, model: MapModel, *, dtype: Any = np.int8
) -> None:
    """Write a model's folder in one step; an earlier model there is replaced."""
    with atomic_folder(folder, marker=MARKER) as scratch:
        write_params(scratch / WEIGHTS, model.params, dtype=dtype)
        digest = hashlib.sha256((scratch / WEIGHTS).read_bytes()).hexdigest()
        values = {
            "format": FORMAT,
            "weights_sha256": digest,
            "method": model.method,
            "network": network_fields(model.network),
            "map": dataclasses.asdict(model.spec),
            "confidence": {
                "frequencies": np.round(model.confidence.frequencies, 6).tolist()
            },
            "purpose": model.purpose,
            "trained_on": model.trained_on,
        }
        text = json.dumps(values, indent=2, default=float) + "\n"
        (scratch / MARKER).write_text(text)


def load_map_model(folder: Path | str) -> MapModel:
    """Load a shipped model of maps by its name, or any by its folder.

    The folder can also be the workdir of a training. Raises ModelError, with the
    reason, for a model that is missing or damaged.
    """
    shipped = SHIPPED / folder
    folder = shipped if (shipped / MARKER).is_file() else Path(folder)
    if not (folder / MARKER).is_file() and (folder / "model").is_dir():
        folder /= "model"
    path, weights = folder / MARKER, folder / WEIGHTS
    if not path.is_file() or not weights.is_file():
        raise ModelError(
            f"no model of maps at {folder}: expected a folder with {MARKER} and "
            f"{WEIGHTS}, or the name of a shipped one"
        )
    try:
        values = read_json(path, limit=1 << 20)
        if values["format"] != FORMAT:
            raise ValueError(f"format {values['format']}, expected {FORMAT}")
        if (method := values["method"]) not in METHODS:
            raise ValueError(f"method {method!r}, expected one of {[*METHODS]}")
        network = network_from_fields(values["network"])
        spec = MapSpec(**typed_fields(MapSpec, values["map"]))
        confidence = ConfidenceTable.of(**values["confidence"])
        params = read_params(weights)
        if hashlib.sha256(weights.read_bytes()).hexdigest() != values["weights_sha256"]:
            raise ValueError(f"{WEIGHTS} does not match its digest: damaged?")
        tile, heights = spec.tile, spec.heights
        if wrong := misfit(
            params,
            network,
            image_shape=(tile, tile, heights),
            condition_shape=(tile, tile, heights + EXTRA),
        ):
            raise ValueError(f"{WEIGHTS} does not fit the network: {wrong}")
    except Exception as error:  # values of a wrong kind raise errors of any kind
        raise ModelError(f"{path} is not usable: {error}") from error
    return MapModel(
        params,
        network,
        spec,
        method,
        confidence,
        str(values.get("purpose", "")),
        str(values.get("trained_on", "")),
    )
