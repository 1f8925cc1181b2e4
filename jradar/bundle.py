"""A trained model as one folder, which `enhance` loads.

weights.safetensors    parameters of the network in half precision, named by their path
bundle.json            everything needed to use them: network, noise levels, image
                       specs, codec, options of the radar points; what they were
                       trained on and for how many steps; the weights' digest

Bundles that come with the package are folders of `jradar/weights`, named after what
they were trained on.
"""

import dataclasses
import functools
import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import flax.traverse_util
import jax
import jax.numpy as jnp
import numpy as np
import safetensors
import safetensors.numpy

from jradar.diffusion import NoiseSpec, UNet
from jradar.files import atomic_path
from jradar.radar import RadarSpec
from jradar.range_image import CHANNELS, ImageSpec

FORMAT = 2
MAX_JSON_BYTES = 1 << 20
WEIGHTS = Path(__file__).with_name("weights")  # what the package ships
DEFAULT = "jradar-sim"


class BundleError(ValueError):
    """A bundle that is missing, damaged or of another format."""


@dataclasses.dataclass(frozen=True)
class BundleSpec:
    """How a network is used, and where its weights come from."""

    network: UNet
    noise: NoiseSpec
    coarse: ImageSpec
    fine: ImageSpec
    radar: RadarSpec
    num_slices: int
    codec: str
    steps_seen: int
    trained_on: str
    purpose: str = ""  # said to users of the weights, "smoke test" for one
    validity_threshold: float = 0.0
    temperature: float = 1.0
    # Options of `radar_points` for the condition.
    points: dict[str, Any] = dataclasses.field(default_factory=dict, hash=False)

    @property
    def sampling(self) -> dict[str, float]:
        """Options of `draw_range_image` that were chosen on validation data."""
        return {
            "validity_threshold": self.validity_threshold,
            "temperature": self.temperature,
        }


class Bundle(NamedTuple):
    """Weights and what they mean."""

    params: Any
    spec: BundleSpec


def save_bundle(folder: Path | str, bundle: Bundle) -> None:
    """Write a bundle; what stood in its place is replaced when it is complete."""
    flat = flax.traverse_util.flatten_dict(bundle.params, sep="/")
    weights = safetensors.numpy.save(
        {k: np.asarray(v, np.float16) for k, v in flat.items()},
        {"network": json.dumps(_to_json(bundle.spec.network))},
    )
    fields = dataclasses.fields(BundleSpec)
    description = {field.name: getattr(bundle.spec, field.name) for field in fields}
    description = {k: _to_json(v) for k, v in description.items()}
    header = {"format": FORMAT, "weights_sha256": hashlib.sha256(weights).hexdigest()}
    with atomic_path(folder) as scratch:
        scratch.mkdir()
        (scratch / "weights.safetensors").write_bytes(weights)
        text = json.dumps(header | description, indent=2)
        (scratch / "bundle.json").write_text(text + "\n")


def load_bundle(folder: Path | str) -> Bundle:
    """Read a bundle, its parameters as float32.

    Raises BundleError, with the reason, for one that is not whole.
    """
    folder = Path(folder)
    description_path, weights_path = (
        folder / "bundle.json",
        folder / "weights.safetensors",
    )
    if not description_path.is_file() or not weights_path.is_file():
        raise BundleError(
            f"no weights at {folder}: expected a folder with bundle.json and "
            "weights.safetensors, as training leaves in its workdir"
        )
    if description_path.stat().st_size > MAX_JSON_BYTES:
        raise BundleError(f"{description_path} is larger than {MAX_JSON_BYTES:,} bytes")
    try:
        values = json.loads(description_path.read_text())
        found, digest = values.pop("format"), values.pop("weights_sha256")
        if found != FORMAT:
            raise BundleError(f"{folder} has format {found}, expected {FORMAT}")
        spec = BundleSpec(
            **{
                **values,
                "network": UNet(**_tuples(values["network"])),
                "noise": NoiseSpec(**values["noise"]),
                "coarse": ImageSpec(**_tuples(values["coarse"])),
                "fine": ImageSpec(**_tuples(values["fine"])),
                "radar": RadarSpec.from_dict(values["radar"]),
                "points": _tuples(values["points"]),
            }
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise BundleError(f"{description_path} is not usable: {error}") from error
    weights = weights_path.read_bytes()
    if hashlib.sha256(weights).hexdigest() != digest:
        raise BundleError(f"{weights_path} does not match its digest: is it damaged?")
    try:
        flat = safetensors.numpy.load(weights)
    except safetensors.SafetensorError as error:
        raise BundleError(f"{weights_path} is not usable: {error}") from error
    _check_shapes(weights_path, flat, spec)
    params = flax.traverse_util.unflatten_dict(flat, sep="/")
    return Bundle(jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), params), spec)


def shipped_bundles() -> dict[str, Path]:
    """Folders of the bundles that come with the package, by name; there may be none."""
    found = sorted(path.parent for path in WEIGHTS.glob("*/bundle.json"))
    return {folder.name: folder for folder in found}


def default_bundle() -> Path:
    """The shipped bundle `jradar-sim`; BundleError where it is not shipped."""
    shipped = shipped_bundles()
    if DEFAULT not in shipped:
        others = f", only {', '.join(shipped)}: name one" if shipped else ""
        raise BundleError(
            f"this version ships no weights {DEFAULT!r}{others}; or train a model, and "
            "name the folder `bundle` in its workdir as --weights"
        )
    return shipped[DEFAULT]


def _check_shapes(path, flat, spec):
    """Refuse weights that are not those of the network, naming the first."""
    channels = len(CHANNELS) * spec.num_slices
    try:
        wanted = _shapes(spec.network, spec.fine.shape, (*spec.coarse.shape, channels))
    except (TypeError, ValueError) as error:
        raise BundleError(
            f"the network of {path.parent} cannot be built: {error}"
        ) from error
    found = {name: tensor.shape for name, tensor in flat.items()}
    wrong = sorted(n for n in found | wanted if found.get(n) != wanted.get(n))
    if wrong:
        first = wrong[0]
        raise BundleError(
            f"{path} does not fit its network: {first} is "
            f"{found.get(first, 'missing')}, expected {wanted.get(first, 'none')} "
            f"({len(wrong)} such)"
        )


@functools.lru_cache(8)
def _shapes(network, image, condition):
    """Shapes of the network's parameters by name."""
    params = jax.eval_shape(
        network.init,
        jax.random.key(0),
        jnp.zeros((1, *image, 2)),  # range and validity
        jnp.zeros(1),
        jnp.zeros((1, *condition)),
    )
    flat: dict[str, Any] = flax.traverse_util.flatten_dict(params, sep="/")
    return {name: leaf.shape for name, leaf in flat.items()}


def _to_json(value: Any) -> Any:
    """A spec, a network or an option as JSON takes it."""
    if isinstance(value, UNet):
        skipped = ("parent", "name", "dtype")
        names = [f.name for f in dataclasses.fields(value) if f.name not in skipped]
        return {name: getattr(value, name) for name in names}
    if isinstance(value, NoiseSpec | ImageSpec | RadarSpec):
        return dataclasses.asdict(value)
    return value


def _tuples(values: dict[str, Any]) -> dict[str, Any]:
    """The dictionary with its lists as tuples, as specs have them."""
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
