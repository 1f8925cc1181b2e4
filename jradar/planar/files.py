"""A planar model on disk: weights, and a description of the same name with them.

NAME.safetensors    the network's parameters, named by path
NAME.json           spec, confidence, its scaling and least share, confidence of the
                    radar's points, trust and card; the digest of the weights
"""

import dataclasses
import hashlib
import json
from pathlib import Path

from jradar.diffusion import (
    OCCUPANCY,
    NoiseSpec,
    misfit,
    network_fields,
    parameter_shapes,
    read_params,
)
from jradar.diffusion.weights.files import MAX_FILE_BYTES
from jradar.errors import ModelError
from jradar.fields import typed_fields
from jradar.files import open_file, read_json, write_text
from jradar.model.folder import (
    MAX_JSON_BYTES,
    card_from_json,
    check_size,
    network_from_json,
    table_to_json,
)
from jradar.planar.agreement import Scaling
from jradar.planar.grid import LIDAR
from jradar.planar.model import PlanarModel, PlanarSpec
from jradar.range_image import ConfidenceTable, TrustTable

KIND, FORMAT = "planar", 3
RESULTS = Path(__file__).parents[2] / "experiments" / "results"  # of a clone
ELSEWHERE = {  # models by name that the package does not contain
    "radarhd": (
        "the weights of radarhd are not part of the package, because RadarHD states no "
        "licence for the data that they were trained on: in a clone of jradar, "
        "--model experiments/results/radarhd.json names them. This command trains "
        "them, for --model runs/radarhd: python -m experiments.main "
        "--config=experiments/configs/radarhd.py --config.data.path=dataset_5 "
        "--workdir=runs/radarhd"
    )
}


def planar_description(name: Path | str) -> Path | None:
    """Return the description of a planar model, None if there is none.

    `name` is that of a model in a clone's `experiments/results`, the path of its
    weights or of its description, or the workdir of a training.
    """
    path = Path(name)
    places = [path / "weights.json", RESULTS / f"{path.name}.json"]
    if path.suffix in (".json", ".safetensors"):
        places = [path.with_suffix(".json")]
    elif path.name != str(name):  # not a bare name
        places = places[:1]
    return next((place for place in places if place.is_file()), None)


def load_planar_model(name: Path | str) -> PlanarModel:
    """Load a planar model by what `planar_description` takes.

    Raises ModelError, with the reason, for a model that is missing or damaged.
    """
    path = planar_description(name)
    if path is None:
        raise ModelError(
            ELSEWHERE.get(str(name))
            or f"no planar model at {name}: expected weights and their description in "
            "one folder, such as weights.safetensors and weights.json"
        )
    weights = path.with_suffix(".safetensors")
    try:
        values = read_json(path, limit=MAX_JSON_BYTES)
        kind, found = values.pop("kind"), values.pop("format")
        if (kind, found) != (KIND, FORMAT):
            raise ValueError(
                f"kind {kind!r} and format {found}, expected {KIND!r} and {FORMAT}; an "
                "evaluation describes it anew"
            )
        digest = values.pop("weights_sha256")
        if not weights.is_file():
            raise ValueError(f"{weights} is missing")
        with open_file(weights, limit=MAX_FILE_BYTES) as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != digest:
                raise ValueError(
                    f"{weights} does not match its digest: the file is damaged, or was "
                    "trained anew; an evaluation describes it anew"
                )
        card = card_from_json(values.pop("card"))
        confidence = ConfidenceTable.of(values.pop("confidence"))
        scaling = Scaling.of(**values.pop("scaling"))
        share = _share("least_share", values.pop("least_share"))
        alone = _share("least_alone", values.pop("least_alone", 0.0))
        if (echoes := values.pop("echoes", None)) is not None:
            echoes = ConfidenceTable.of(echoes)
        echo_share = _share("echo_share", values.pop("echo_share", 0.5))
        if (trust := values.pop("trust", None)) is not None:
            trust = TrustTable.of(**trust)
        network = network_from_json(values.pop("network"))
        noise = typed_fields(NoiseSpec, values.pop("noise"))
        noise = NoiseSpec(**noise, prediction=OCCUPANCY)
        others = typed_fields(PlanarSpec, values)
        spec = PlanarSpec(network=network, noise=noise, **others)
        params = read_params(weights)
        check_size(network, parameter_shapes(params))
        if wrong := misfit(
            params,
            network,
            image_shape=(*LIDAR.shape, 1),
            condition_shape=spec.condition_shape,
        ):
            raise ValueError(f"{weights} does not fit its network: {wrong}")
    except Exception as error:  # values of a wrong kind raise errors of any kind
        raise ModelError(f"{path} is not usable: {error}") from error
    tables = confidence, trust, scaling, share, echoes, echo_share, alone
    return PlanarModel(params, spec, card, *tables)


def _frequencies(table):
    """The part of a table that a planar model takes: it leaves out by shares."""
    return table_to_json(table)["frequencies"]


def _share(name, value):
    """A number from 0 to 1."""
    if not isinstance(value, int | float) or not 0 <= value <= 1:
        raise ValueError(f"{name} = {value!r}, expected 0 to 1")
    return value


def describe_planar_model(weights: Path, model: PlanarModel, *, folder: Path) -> Path:
    """Write the description of weights to a folder; return its path.

    The model is complete when both files are in one folder.
    """
    spec, path = model.spec, folder / f"{weights.stem}.json"
    noise = dataclasses.asdict(spec.noise)
    noise.pop("prediction")
    values = {
        "kind": KIND,
        "format": FORMAT,
        "weights_sha256": hashlib.sha256(weights.read_bytes()).hexdigest(),
        "method": spec.method,
        "history": spec.history,
        "network": network_fields(spec.network),
        "noise": noise,
        "confidence": _frequencies(model.confidence),
        "scaling": table_to_json(model.scaling),
        "least_share": float(model.least_share),
        "least_alone": float(model.least_alone),
        "echoes": None if model.echoes is None else _frequencies(model.echoes),
        "echo_share": float(model.echo_share),
        "trust": None if model.trust is None else table_to_json(model.trust),
        "card": dataclasses.asdict(model.card),
    }
    write_text(path, json.dumps(values, indent=2) + "\n")
    return path
