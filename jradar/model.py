"""The front door: a trained model, and the paper in three functions.

    model = load_model("jradar-sim")       # shipped with the package, or a folder
    cloud = enhance(key, cube, model)      # ADC cube to a dense PointCloud

`enhance` is `condition`, then `draw`, then `unproject`. A `Model` is a pytree, so all
three take it as an argument under `jit`, `vmap` and `grad`: its parameters are the
leaves, and its `ModelSpec` is static.

A model is stored as a folder:

    weights.safetensors    the network's parameters in half precision, named by path
    model.json             the ModelSpec, and the digest of the weights
"""

import dataclasses
import functools
import hashlib
import json
from pathlib import Path
from typing import Any

import flax.traverse_util
import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Key

from jradar.diffusion import (
    NETWORKS,
    PREDICTIONS,
    SOLVERS,
    Denoiser,
    Network,
    NoiseSpec,
    Solver,
    conditional_denoiser,
    network_fields,
    network_from_fields,
    read_params,
    regression_estimate,
    sample,
    write_params,
)
from jradar.errors import ModelError, UsageError
from jradar.files import atomic_folder, read_json, typed_fields
from jradar.radar import PointSpec, RadarSpec, radar_points
from jradar.range_image import (
    CHANNELS,
    ImageSpec,
    TrustSpec,
    agreed_range,
    condition_image,
    decode_target,
    unproject,
)
from jradar.types import PointCloud

FORMAT = 3
MAX_JSON_BYTES = 1 << 20
MAX_PIXELS = 1 << 24
SHIPPED = Path(__file__).with_name("weights")


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """Everything about a model except its parameters.

    `method` is how the network answers: "diffusion" draws samples, "regression" gives
    one estimate. `purpose` is shown to users of the weights.
    """

    method: str
    network: Network
    noise: NoiseSpec
    coarse: ImageSpec  # of the condition
    fine: ImageSpec  # of the result
    radar: RadarSpec
    points: PointSpec
    num_slices: int
    codec: str
    steps_seen: int
    trained_on: str
    purpose: str = ""
    validity_threshold: float = 0.0
    temperature: float = 1.0  # of a single draw
    trust: TrustSpec | None = None  # what conditions looked like in training

    def __post_init__(self):
        """Refuse an unknown method."""
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}, expected one of {[*METHODS]}")


@functools.partial(
    jax.tree_util.register_dataclass, data_fields=["params"], meta_fields=["spec"]
)
@dataclasses.dataclass(frozen=True)
class Model:
    """A trained network: a pytree whose leaves are the parameters."""

    params: Any
    spec: ModelSpec


@functools.partial(
    jax.jit, static_argnames=("radar", "range_bias_m", "draws", "steps", "solver")
)
def enhance(
    key: Key[Array, ""],
    cube: Complex[Array, "tx rx chirp sample"],
    model: Model,
    *,
    radar: RadarSpec | None = None,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
    **drawing: Any,
) -> PointCloud:
    """Return the dense, LiDAR-like cloud of one radar frame (Fig. 3b).

    `drawing` are options of `draw`, the others are those of `condition`. One frame;
    `vmap` it.
    """
    sensor = {"radar": radar, "coupling": coupling, "range_bias_m": range_bias_m}
    image = draw(key, condition(cube, model, **sensor), model, **drawing)
    return unproject(image, model.spec.fine)


@functools.partial(jax.jit, static_argnames=("radar", "range_bias_m"))
def condition(
    cube: Complex[Array, "tx rx chirp sample"],
    model: Model,
    *,
    radar: RadarSpec | None = None,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
) -> Float[Array, "row column channel"]:
    """Return the network's input: the radar points of one frame as range images.

    `radar` is the sensor that recorded the cube, by default the model's own. `coupling`
    and `range_bias_m` are as in `radar_points`. One frame; `vmap` it. Raises ValueError
    for a cube that does not fit the radar.
    """
    spec = model.spec
    points = spec.points if radar is None else spec.points.fitted(radar)
    cloud = radar_points(
        cube,
        radar or spec.radar,
        points=points,
        coupling=coupling,
        range_bias_m=range_bias_m,
    )
    return condition_image(cloud, spec.coarse, num_slices=spec.num_slices)


@functools.partial(jax.jit, static_argnames=("draws", "steps", "solver"))
def draw(
    key: Key[Array, ""],
    condition: Float[Array, "row column channel"],
    model: Model,
    *,
    draws: int | None = None,
    steps: int | None = None,
    solver: Solver | None = None,
    temperature: float | Float[Array, ""] | None = None,
) -> Float[Array, "fine_row fine_column"]:
    """Return a LiDAR-like range image in metres, 0 where nothing is seen.

    A diffusion model takes `draws` samples at once, 8 by default, and returns the range
    on which they agree (`agreed_range`). `draws=1` is the paper's single sample, and
    `draws=1, steps=1` its one-step estimate. Defaults for several draws: 5 steps of
    iPNDM, temperature 1; for one: 18 steps, the model's temperature, and the solver of
    `solver_for`: Heun, or iPNDM below 8 steps.

    A regression model has one answer and takes none of these options. Without a radar
    point in the condition the image is empty. One condition; `vmap` it. Raises
    ValueError for options that the model does not take.
    """
    spec = model.spec
    denoise = conditional_denoiser(spec.network, model.params, spec.noise)
    options = {
        "draws": draws,
        "steps": steps,
        "solver": solver,
        "temperature": temperature,
    }
    given = {name: value for name, value in options.items() if value is not None}
    image = METHODS[spec.method](key, denoise(condition[None]), spec, **given)
    return jnp.where(condition.any(), image, 0.0)


def _draw_diffusion(
    key: Key[Array, ""],
    denoise: Denoiser,
    spec: ModelSpec,
    *,
    draws: int = 8,
    **sampling: Any,
) -> Float[Array, "fine_row fine_column"]:
    """One sample, or what several agree on."""
    if draws < 1:
        raise ValueError(f"{draws=}, expected 1 or more")
    quick = {"solver": SOLVERS["ipndm3"], "steps": 5, "temperature": 1.0}
    careful = {"steps": 18, "temperature": spec.temperature}
    values = sample(
        key,
        denoise,
        (draws, *spec.fine.shape, 2),
        noise=spec.noise,
        **{**(careful if draws == 1 else quick), **sampling},
    )
    images = _metres(values, spec)
    return images[0] if draws == 1 else agreed_range(images)


def _draw_regression(
    key: Key[Array, ""], denoise: Denoiser, spec: ModelSpec, **sampling: Any
) -> Float[Array, "fine_row fine_column"]:
    """The network's one estimate; `key` is not used."""
    if sampling:
        raise UsageError(
            f"{', '.join(sampling)}: a model trained by regression draws no samples, "
            "leave these options out"
        )
    values = regression_estimate(denoise, (1, *spec.fine.shape, 2), noise=spec.noise)
    return _metres(values, spec)[0]


# How a model of each method turns a condition into a range image.
METHODS = {"diffusion": _draw_diffusion, "regression": _draw_regression}


def _metres(values, spec):
    """Range images in metres from the network's values."""
    return decode_target(
        values,
        spec.fine,
        codec=spec.codec,
        validity_threshold=spec.validity_threshold,
    )


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


def save_model(folder: Path | str, model: Model) -> None:
    """Write a model's folder in one step; an earlier model there is replaced.

    Raises UsageError for a folder that holds something else.
    """
    with atomic_folder(folder, marker="model.json") as scratch:
        weights = scratch / "weights.safetensors"
        network = json.dumps(network_fields(model.spec.network))
        write_params(weights, model.params, metadata={"network": network})
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
    specs = ("coarse", "fine", "radar", "points", "trust")
    return {
        **plain,
        **{name: dataclasses.asdict(plain[name]) for name in specs if plain[name]},
        "network": network_fields(spec.network),
        "noise": dataclasses.asdict(noise) | {"prediction": noise.prediction.name},
    }


def _spec_from_json(values: dict[str, Any]) -> ModelSpec:
    """The spec from `_spec_to_json`'s dictionary, with every type checked."""
    read: dict[str, Any] = {"network": _network_from_json(values.pop("network"))}
    noise = values.pop("noise")
    prediction = PREDICTIONS[noise.pop("prediction")]
    read["noise"] = NoiseSpec(**typed_fields(NoiseSpec, noise), prediction=prediction)
    read["radar"] = RadarSpec.from_dict(values.pop("radar"))
    if (trust := values.pop("trust", None)) is not None:
        read["trust"] = TrustSpec(**typed_fields(TrustSpec, trust))
    spec = ModelSpec(**read, **typed_fields(ModelSpec, values))
    for name, image in (("coarse", spec.coarse), ("fine", spec.fine)):
        if image.height * image.width > MAX_PIXELS:
            size = f"{image.height} x {image.width} pixels"
            raise ValueError(f"{name} has {size}, expected at most {MAX_PIXELS:,}")
    return spec


def _network_from_json(values: dict[str, Any]) -> Network:
    """The network from `network_fields`' dictionary."""
    fields = dict(values)
    kind = NETWORKS[fields.pop("kind")]
    typed_fields(kind, fields)
    return network_from_fields(values)


def _check_shapes(path: Path, params: Any, spec: ModelSpec) -> None:
    """Refuse parameters that do not fit the network, naming the first."""
    channels = len(CHANNELS) * spec.num_slices
    found = _flat_shapes(params)
    try:
        _check_size(spec.network, len(found))
        expected = _shapes(
            spec.network, spec.fine.shape, (*spec.coarse.shape, channels)
        )
    except Exception as error:  # Flax and JAX have their own
        raise ModelError(
            f"the network of {path.parent} cannot be built: {error}"
        ) from error
    wrong = sorted(n for n in found | expected if found.get(n) != expected.get(n))
    if wrong:
        first = wrong[0]
        raise ModelError(
            f"{path} does not fit its network: {first} is "
            f"{found.get(first, 'missing')}, expected "
            f"{expected.get(first, 'no such parameter')} ({len(wrong)} differ)"
        )


def _check_size(network: Network, most: int) -> None:
    """Refuse a network of more blocks than the file has arrays: it takes hours."""
    fields = network_fields(network)
    blocks = fields.get("blocks", 1) * len(fields.get("multipliers", [1]))
    if blocks > most:
        raise ValueError(f"{blocks:,} blocks for {most:,} arrays of parameters")


@functools.lru_cache(8)
def _shapes(network, image, condition):
    """Shapes of the network's parameters by name."""
    return _flat_shapes(
        jax.eval_shape(
            network.init,
            jax.random.key(0),
            jax.ShapeDtypeStruct((1, *image, 2), jnp.float32),  # range and validity
            jax.ShapeDtypeStruct((1,), jnp.float32),
            jax.ShapeDtypeStruct((1, *condition), jnp.float32),
        )
    )


def _flat_shapes(params: Any) -> dict[str, tuple[int, ...]]:
    """Shapes of parameters by their path."""
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(params, sep="/")
    return {name: leaf.shape for name, leaf in flat.items()}
