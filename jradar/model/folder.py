"""A model on disk: a folder with its weights and its description.

weights.safetensors    the network's parameters, named by path
model.json             spec, tables and card, and the digest of the weights
"""

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from jradar.diffusion import (
    NETWORKS,
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
from jradar.model.spec import Card, Model, ModelSpec
from jradar.radar import RadarSpec
from jradar.range_image import CHANNELS, ConfidenceTable, TrustTable

FORMAT = 4
MAX_JSON_BYTES = 1 << 20
MAX_PIXELS = 1 << 24
SHIPPED = Path(__file__).parents[1] / "weights"


def shipped_models() -> dict[str, Path]:
    """Return the folders of the models that come with the package, by name."""
    found = sorted(path.parent for path in SHIPPED.glob("*/model.json"))
    return {folder.name: folder for folder in found}


def load_model(name: Path | str) -> Model:
    """Load a shipped model by its name, or any model by its folder.

    The folder can also be the workdir of a training, which holds it as `model`.
    Parameters become float32. Raises ModelError, with the reason, for a model that is
    missing, damaged or of another format.
    """
    model, digest, weights = _described(name)
    try:
        with open_file(weights, limit=MAX_FILE_BYTES) as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
        if found != digest:
            raise ValueError(
                f"{weights} does not match the digest in model.json: the file is "
                "damaged, or from another model"
            )
        params = read_params(weights)
    except ValueError as error:
        raise ModelError(str(error)) from error
    if str(name) not in shipped_models():  # those are checked by the tests
        _check_shapes(weights, params, model.spec)
    return dataclasses.replace(model, params=params)


def load_card(name: Path | str) -> Card:
    """Return where a model comes from, without reading its weights; as `load_model`."""
    return _described(name)[0].card


def _described(name: Path | str) -> tuple[Model, str, Path]:
    """The model without parameters, the digest of its weights, and their file."""
    shipped = shipped_models()
    folder = shipped.get(str(name), Path(name))
    if not (folder / "model.json").is_file() and (folder / "model").is_dir():
        folder /= "model"
    path, weights = folder / "model.json", folder / "weights.safetensors"
    if not path.is_file() or not weights.is_file():
        raise ModelError(
            f"no model at {folder}: expected a folder with model.json and "
            "weights.safetensors, the workdir of a training, which holds one, or the "
            f"name of a shipped model: {', '.join(shipped) or 'none is shipped'}"
        )
    try:
        values = read_json(path, limit=MAX_JSON_BYTES)
        found, digest = values.pop("format"), values.pop("weights_sha256")
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
    with atomic_folder(folder, marker="model.json") as scratch:
        weights = scratch / "weights.safetensors"
        network = json.dumps(network_fields(model.spec.network))
        write_params(weights, model.params, metadata={"network": network}, dtype=dtype)
        header = {
            "format": FORMAT,
            "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        }
        text = json.dumps(header | _model_to_json(model), indent=2)
        (scratch / "model.json").write_text(text + "\n")


def _model_to_json(model: Model) -> dict[str, Any]:
    """Everything but the parameters as JSON takes it."""
    spec, card = model.spec, model.card
    noise, dtype = spec.noise, str(getattr(spec.network, "dtype", "float32"))
    other = {} if dtype == "float32" else {"dtype": dtype}
    return {
        **{f.name: getattr(spec, f.name) for f in dataclasses.fields(spec)},
        **{n: dataclasses.asdict(getattr(spec, n)) for n in ("coarse", "fine")},
        "points": dataclasses.asdict(spec.points),
        "network": network_fields(spec.network) | other,
        "noise": dataclasses.asdict(noise) | {"prediction": noise.prediction.name},
        "confidence": table_to_json(model.confidence),
        "trust": None if model.trust is None else table_to_json(model.trust),
        "echoes": None if model.echoes is None else table_to_json(model.echoes),
        "card": dataclasses.asdict(card),
    }


def table_to_json(table: Any) -> dict[str, Any]:
    """The numbers of a table as they were fitted, without the noise of float32."""
    parts = {k: np.asarray(v, float).round(6) for k, v in table._asdict().items()}
    return {name: values.tolist() for name, values in parts.items()}


def _model_from_json(values: dict[str, Any]) -> Model:
    """The model without parameters from `_model_to_json`'s dictionary, checked."""
    card = card_from_json(values.pop("card"))
    confidence = ConfidenceTable.of(**values.pop("confidence"))
    if (trust := values.pop("trust")) is not None:
        trust = TrustTable.of(**trust)
    if (echoes := values.pop("echoes", None)) is not None:  # earlier files lack it
        echoes = ConfidenceTable.of(**echoes)
    network = network_from_json(values.pop("network"))
    noise = values.pop("noise")
    prediction = PREDICTIONS[noise.pop("prediction")]
    noise = NoiseSpec(**typed_fields(NoiseSpec, noise), prediction=prediction)
    spec = ModelSpec(network=network, noise=noise, **typed_fields(ModelSpec, values))
    for name, image in (("coarse", spec.coarse), ("fine", spec.fine)):
        if image.height * image.width > MAX_PIXELS:
            size = f"{image.height} x {image.width} pixels"
            raise ValueError(f"{name} has {size}, expected at most {MAX_PIXELS:,}")
    return Model({}, spec, card, confidence, trust, echoes)


def card_from_json(values: dict[str, Any]) -> Card:
    """The card, with every type checked."""
    radars = values.pop("radars")
    if not isinstance(radars, list):
        raise ValueError(f"radars is {radars!r}, expected a list of radars")
    radars = tuple(RadarSpec.from_dict(radar) for radar in radars)
    return Card(**typed_fields(Card, values), radars=radars)


def network_from_json(values: dict[str, Any]) -> Network:
    """The network from `network_fields`' dictionary."""
    fields = dict(values)
    kind = NETWORKS[fields.pop("kind")]
    typed_fields(kind, fields)
    return network_from_fields(values)


def _check_shapes(path: Path, params: Any, spec: ModelSpec) -> None:
    """Refuse parameters that do not fit the network, naming the first."""
    channels = len(CHANNELS) * spec.num_slices
    found = parameter_shapes(params)
    try:
        check_size(spec.network, found)
        wrong = misfit(
            params,
            spec.network,
            image_shape=(*spec.fine.shape, 2),  # range and validity
            condition_shape=(*spec.coarse.shape, channels),
        )
    except Exception as error:  # Flax and JAX have their own
        raise ModelError(
            f"the network of {path.parent} cannot be built: {error}"
        ) from error
    if wrong:
        raise ModelError(f"{path} does not fit its network: {wrong}")


def check_size(network: Network, found: dict[str, tuple[int, ...]]) -> None:
    """Refuse a network larger than the file: its shapes take hours, or gigabytes."""
    fields = network_fields(network)
    blocks = fields.get("blocks", 1) * len(fields.get("multipliers", [1]))
    if blocks > len(found):
        raise ValueError(f"{blocks:,} blocks for {len(found):,} arrays of parameters")
    channels = fields.get("channels", 0)
    widest = max((size for shape in found.values() for size in shape), default=0)
    if channels > widest:
        raise ValueError(f"{channels:,} channels for arrays of at most {widest:,}")
