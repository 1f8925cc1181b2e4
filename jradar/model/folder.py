"""A model on disk: a folder with its weights and its description.

weights.safetensors    the network's parameters, named by path
model.json             spec, grid, tables and card, and the digest of the weights
"""

import dataclasses
import hashlib
import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from jradar.diffusion import (
    NETWORKS,
    OCCUPANCY,
    PREDICTIONS,
    Network,
    NoiseSpec,
    misfit,
    network_fields,
    network_from_fields,
    parameter_shapes,
    read_params,
    write_params,
)
from jradar.diffusion.weights.files import MAX_FILE_BYTES
from jradar.errors import ModelError
from jradar.fields import typed_fields
from jradar.files import atomic_folder, open_file, read_json
from jradar.model.grids import GRIDS, Grid
from jradar.model.mirror import Scaling
from jradar.model.model import Card, Model, ModelSpec
from jradar.model.tables import Tables
from jradar.options.models import shipped_models
from jradar.radar import RadarSpec
from jradar.range_image import ConfidenceTable, TrustTable

LOG = logging.getLogger(__name__)
FORMAT = 5
MARKER, WEIGHTS = "model.json", "weights.safetensors"
MAX_JSON_BYTES = 1 << 20
MAX_PIXELS = 1 << 24
TABLES: dict[str, Callable[..., Any]] = {
    "confidence": ConfidenceTable.of,
    "echoes": ConfidenceTable.of,
    "trust": TrustTable.of,
    "scaling": Scaling.of,
}


def load_model(name: Path | str) -> Model:
    """Load a shipped model by its name, or any model by its folder.

    The folder can also be the workdir of a training, which holds it as `model`.
    Parameters become float32. Raises ModelError, with the reason, for a model that is
    missing, damaged or of another format.
    """
    model, digest, weights = _described(name)
    LOG.info("the model %s is %s", name, weights)
    try:
        with open_file(weights, limit=MAX_FILE_BYTES) as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if found != digest:
            raise ValueError(
                f"{weights} does not match the digest in {MARKER}: the file is "
                "damaged, or from another model"
            )
        params = read_params(weights)
    except ValueError as error:
        raise ModelError(str(error)) from error
    if str(name) not in shipped_models():  # those are checked by the tests
        _check_shapes(weights, params, model.spec)
    return dataclasses.replace(model, params=params)


def load_card(name: Path | str) -> Card:
    """Return a model's card without reading its weights; errors as in `load_model`."""
    return _described(name)[0].card


def _described(name: Path | str) -> tuple[Model, str, Path]:
    """Return a model without parameters, the digest of its weights, and their file."""
    shipped = shipped_models()
    folder = shipped.get(str(name), Path(name))
    if not (folder / MARKER).is_file() and (folder / "model").is_dir():
        folder /= "model"
    path, weights = folder / MARKER, folder / WEIGHTS
    if not path.is_file() or not weights.is_file():
        raise ModelError(
            f"no model at {folder}: expected a folder with {MARKER} and {WEIGHTS}, the "
            "workdir of a training, which holds one, or the name of a shipped model: "
            f"{', '.join(shipped) or 'none is shipped'}"
        )
    try:
        values = read_json(path, limit=MAX_JSON_BYTES)
        found, digest = values.pop("format"), str(values.pop("weights_sha256"))
        if found != FORMAT:
            raise ModelError(
                f"{path} has format {found}, this version reads {FORMAT}: train again, "
                "or use the version of jradar that wrote it"
            )
        return _model_from_json(values), digest, weights
    except ModelError:
        raise
    except Exception as error:  # values of a wrong kind raise errors of any kind
        raise ModelError(f"{path} is not usable: {error}") from error


def save_model(
    folder: Path | str, model: Model, *, dtype: type[np.generic] = np.float16
) -> None:
    """Write a model's folder in one step; an earlier model there is replaced.

    Weights have the precision of `dtype`: float32, float16, or int8, which halves the
    file again (`write_params`). Raises UsageError for a folder that holds something
    else.
    """
    with atomic_folder(folder, marker=MARKER) as scratch:
        weights = scratch / WEIGHTS
        network = json.dumps(network_fields(model.spec.network))
        write_params(weights, model.params, metadata={"network": network}, dtype=dtype)
        header = {
            "format": FORMAT,
            "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        }
        text = json.dumps(header | _model_to_json(model), indent=2)
        (scratch / MARKER).write_text(text + "\n")


def _model_to_json(model: Model) -> dict[str, Any]:
    """Return everything but the parameters, as values for JSON."""
    spec, noise = model.spec, model.spec.noise
    dtype = str(getattr(spec.network, "dtype", "float32"))
    other = {} if dtype == "float32" else {"dtype": dtype}
    return {
        "method": spec.method,
        "grid": {"kind": spec.grid.kind, **dataclasses.asdict(spec.grid)},  # pyright: ignore[reportArgumentType]
        "points": dataclasses.asdict(spec.points),
        "temperature": spec.temperature,
        "network": network_fields(spec.network) | other,
        "noise": dataclasses.asdict(noise) | {"prediction": noise.prediction.name},
        "tables": {
            name: None if table is None else _table_to_json(table)
            for name, table in model.tables._asdict().items()
        },
        "card": dataclasses.asdict(model.card),
    }


def _table_to_json(table: Any) -> dict[str, Any]:
    """Return the numbers of a table as they were fitted, without float32's noise."""
    parts = {k: np.asarray(v, float).round(6) for k, v in table._asdict().items()}
    return {name: values.tolist() for name, values in parts.items()}


def _model_from_json(values: dict[str, Any]) -> Model:
    """Return a model without parameters, from the checked values of a file."""
    card = _card_from_json(values.pop("card"))
    tables: dict[str, Any] = {
        name: None if table is None else TABLES[name](**table)
        for name, table in values.pop("tables").items()
    }
    grid = _grid_from_json(values.pop("grid"))
    network = _network_from_json(values.pop("network"))
    noise = values.pop("noise")
    prediction = ({OCCUPANCY.name: OCCUPANCY} | PREDICTIONS)[noise.pop("prediction")]
    noise = NoiseSpec(**typed_fields(NoiseSpec, noise), prediction=prediction)
    fields = typed_fields(ModelSpec, values)
    spec = ModelSpec(network=network, noise=noise, grid=grid, **fields)
    return Model({}, spec, Tables(**tables), card)


def _grid_from_json(values: dict[str, Any]) -> Grid:
    """Return the grid; ValueError if its images are too large to be drawn."""
    kind = GRIDS[values.pop("kind")]
    grid = kind(**typed_fields(kind, values))
    shapes = {"image": grid.image_shape, "condition": grid.condition_shape}
    for name, (rows, columns, _) in shapes.items():
        if rows * columns > MAX_PIXELS:
            size = f"{rows} x {columns} pixels"
            raise ValueError(f"{name} has {size}, expected at most {MAX_PIXELS:,}")
    return grid


def _card_from_json(values: dict[str, Any]) -> Card:
    """Return the card, with every type checked."""
    radars = values.pop("radars")
    if not isinstance(radars, list):
        raise ValueError(f"radars is {radars!r}, expected a list of radars")
    radars = tuple(RadarSpec.from_dict(radar) for radar in radars)
    return Card(**typed_fields(Card, values), radars=radars)


def _network_from_json(values: dict[str, Any]) -> Network:
    """Return the network from the dictionary of `network_fields`."""
    fields = dict(values)
    kind = NETWORKS[fields.pop("kind")]
    typed_fields(kind, fields)
    return network_from_fields(values)


def _check_shapes(path: Path, params: Any, spec: ModelSpec) -> None:
    """Raise ModelError for parameters that do not fit the network; it names one."""
    found = parameter_shapes(params)
    try:
        _check_size(spec.network, found)
        wrong = misfit(
            params,
            spec.network,
            image_shape=spec.grid.image_shape,
            condition_shape=spec.grid.condition_shape,
        )
    except Exception as error:  # Flax and JAX raise errors of their own kinds
        raise ModelError(
            f"the network of {path.parent} cannot be built: {error}"
        ) from error
    if wrong:
        raise ModelError(f"{path} does not fit its network: {wrong}")


def _check_size(network: Network, found: dict[str, tuple[int, ...]]) -> None:
    """Refuse a network that is larger than the file: it takes hours, or gigabytes."""
    fields = network_fields(network)
    blocks = fields.get("blocks", 1) * len(fields.get("multipliers", [1]))
    if blocks > len(found):
        raise ValueError(f"{blocks:,} blocks for {len(found):,} arrays of parameters")
    channels = fields.get("channels", 0)
    widest = max((size for shape in found.values() for size in shape), default=0)
    if channels > widest:
        raise ValueError(f"{channels:,} channels for arrays of at most {widest:,}")
