"""A model on disk: a folder with its weights and its description.

weights.safetensors    the network's parameters, named by path
model.json             the ModelSpec, and the digest of the weights
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
from jradar.errors import ModelError
from jradar.files import atomic_folder, read_json, typed_fields
from jradar.model.spec import Model, ModelSpec
from jradar.radar import RadarSpec
from jradar.range_image import CHANNELS, CalibrationSpec, TrustSpec

FORMAT = 3
MAX_JSON_BYTES = 1 << 20
MAX_PIXELS = 1 << 24
SHIPPED = Path(__file__).parents[1] / "weights"


def shipped_models() -> dict[str, Path]:
    """Return the folders of the models that come with the package, by name."""
    found = sorted(path.parent for path in SHIPPED.glob("*/model.json"))
    return {folder.name: folder for folder in found}


def load_model(name: Path | str) -> Model:
    """Load a shipped model by its name, or any model by its folder.

    Parameters become float32. Raises ModelError, with the reason, for a model that is
    missing, damaged or of another format.
    """
    shipped = shipped_models()
    folder = shipped.get(str(name), Path(name))
    path, weights = folder / "model.json", folder / "weights.safetensors"
    if not path.is_file() or not weights.is_file():
        raise ModelError(
            f"no model at {folder}: expected a folder with model.json and "
            "weights.safetensors, such as `model` in the workdir of a training, or the "
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
        spec = _spec_from_json(values)
    except ModelError:
        raise
    except Exception as error:  # values of a wrong kind raise errors of any kind
        raise ModelError(f"{path} is not usable: {error}") from error
    if hashlib.sha256(weights.read_bytes()).hexdigest() != digest:
        raise ModelError(
            f"{weights} does not match the digest in {path.name}: the file is damaged, "
            "or from another model"
        )
    try:
        params = read_params(weights)
    except ValueError as error:
        raise ModelError(str(error)) from error
    if str(name) not in shipped:  # those are checked by the tests
        _check_shapes(weights, params, spec)
    return Model(params, spec)


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
        text = json.dumps(header | _spec_to_json(model.spec), indent=2)
        (scratch / "model.json").write_text(text + "\n")


def _spec_to_json(spec: ModelSpec) -> dict[str, Any]:
    """The spec as JSON takes it."""
    noise = spec.noise
    plain = {f.name: getattr(spec, f.name) for f in dataclasses.fields(spec)}
    specs = ("coarse", "fine", "radar", "points", "trust", "calibration")
    return {
        **plain,
        **{name: dataclasses.asdict(plain[name]) for name in specs if plain[name]},
        "other_radars": [dataclasses.asdict(radar) for radar in spec.other_radars],
        "network": network_fields(spec.network) | _dtype_of(spec.network),
        "noise": dataclasses.asdict(noise) | {"prediction": noise.prediction.name},
    }


def _dtype_of(network: Network) -> dict[str, str]:
    """What the network computes in, unless that is float32."""
    name = str(getattr(network, "dtype", "float32"))
    return {} if name == "float32" else {"dtype": name}


def _spec_from_json(values: dict[str, Any]) -> ModelSpec:
    """The spec from `_spec_to_json`'s dictionary, with every type checked."""
    read: dict[str, Any] = {"network": _network_from_json(values.pop("network"))}
    noise = values.pop("noise")
    prediction = PREDICTIONS[noise.pop("prediction")]
    read["noise"] = NoiseSpec(**typed_fields(NoiseSpec, noise), prediction=prediction)
    read["radar"] = RadarSpec.from_dict(values.pop("radar"))
    if not isinstance(others := values.pop("other_radars", []), list):
        raise ValueError(f"other_radars is {others!r}, expected a list of radars")
    read["other_radars"] = tuple(RadarSpec.from_dict(radar) for radar in others)
    for name, kind in (("trust", TrustSpec), ("calibration", CalibrationSpec)):
        if (found := values.pop(name, None)) is not None:
            read[name] = kind(**typed_fields(kind, found))
    spec = ModelSpec(**read, **typed_fields(ModelSpec, values))
    for name, image in (("coarse", spec.coarse), ("fine", spec.fine)):
        if image.height * image.width > MAX_PIXELS:
            size = f"{image.height} x {image.width} pixels"
            raise ValueError(f"{name} has {size}, expected at most {MAX_PIXELS:,}")
    return spec


def _network_from_json(values: dict[str, Any]) -> Network:
    """The network from `network_fields`' dictionary."""
    if values.get("resample_filter") == [1, 1]:  # recorded by older versions
        values.pop("resample_filter")
    fields = dict(values)
    kind = NETWORKS[fields.pop("kind")]
    typed_fields(kind, fields)
    return network_from_fields(values)


def _check_shapes(path: Path, params: Any, spec: ModelSpec) -> None:
    """Refuse parameters that do not fit the network, naming the first."""
    channels = len(CHANNELS) * spec.num_slices
    found = parameter_shapes(params)
    try:
        _check_size(spec.network, found)
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


def _check_size(network: Network, found: dict[str, tuple[int, ...]]) -> None:
    """Refuse a network larger than the file: its shapes take hours, or gigabytes."""
    fields = network_fields(network)
    blocks = fields.get("blocks", 1) * len(fields.get("multipliers", [1]))
    if blocks > len(found):
        raise ValueError(f"{blocks:,} blocks for {len(found):,} arrays of parameters")
    channels = fields.get("channels", 0)
    widest = max((size for shape in found.values() for size in shape), default=0)
    if channels > widest:
        raise ValueError(f"{channels:,} channels for arrays of at most {widest:,}")
