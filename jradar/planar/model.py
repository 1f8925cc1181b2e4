"""A network of polar images: its answer as an image and as a cloud.

condition [range, azimuth, image]    polar images of the radar, newest first
-> both_ways                         occupancy, or expected nearness    256 x 512
-> frequency of the confidence table, scaled by how much the answers disagree
-> the pixels of a share of the expected F-score
-> plane_cloud                       PointCloud, all points at height 0, with those
                                     around the radar's own
"""

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.diffusion import (
    Network,
    NoiseSpec,
    conditional_denoiser,
    regression_estimate,
)
from jradar.model import Card
from jradar.planar.agreement import (
    UNSCALED,
    Scaling,
    disagreement,
    least_confidence as default_least,
    scaled,
)
from jradar.planar.evidence import near_points, plane_surroundings
from jradar.planar.grid import LIDAR, RADAR
from jradar.radar import PointSpec
from jradar.range_image import IDENTITY, ConfidenceTable, TrustTable, frequency
from jradar.types import PointCloud

METHODS = ("occupancy", "nearness")
MOST_IMAGES = 256  # in a condition
FAINT = 0.02  # value of a pixel that is never a point


@dataclasses.dataclass(frozen=True)
class PlanarSpec:
    """What shapes a planar model's computation, and the radar points shown next to it.

    `method` is what a pixel's value means: the probability of a LiDAR point in it, or
    the expectation of how near the closest one is.
    """

    network: Network
    noise: NoiseSpec
    method: str = "occupancy"
    history: int = 1  # radar images in a condition
    points: PointSpec = PointSpec()

    def __post_init__(self):
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}, expected one of {[*METHODS]}")
        if not 1 <= self.history <= MOST_IMAGES:
            raise ValueError(f"history = {self.history}, expected 1 to {MOST_IMAGES}")

    @property
    def condition_shape(self) -> tuple[int, int, int]:
        """Shape of a condition, [range, azimuth, image]."""
        return (*RADAR.shape, self.history)


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=(
        "params",
        "confidence",
        "trust",
        "scaling",
        "least_share",
        "echoes",
        "echo_share",
        "least_alone",
    ),
    meta_fields=("spec",),
    drop_fields=("card",),
)
@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class PlanarModel:
    """A trained network of polar images: a pytree of parameters and of its tables."""

    params: Any
    spec: PlanarSpec
    card: Card = Card()
    confidence: ConfidenceTable = IDENTITY
    trust: TrustTable | None = None  # what radar images looked like in training
    scaling: Scaling = UNSCALED  # of the confidence, by how much two answers disagree
    # Of the expected F-score: pixels of less confidence than that are left out.
    least_share: float | Float[Array, ""] = 0.5
    echoes: ConfidenceTable | None = None  # of `plane_surroundings`, by crowding
    echo_share: float | Float[Array, ""] = 0.5  # as `least_share`, of these points
    least_alone: float | Float[Array, ""] = 0.0  # of pixels away from all of these

    def __repr__(self) -> str:
        """One line: method, size, and what it was trained on."""
        size = sum(np.size(leaf) for leaf in jax.tree.leaves(self.params)) / 1e6
        trained_on = self.card.trained_on or "unknown data"
        return (
            f"PlanarModel({self.spec.method}, {size:.3g} million parameters, "
            f"{self.card.steps_seen:,} steps on {trained_on})"
        )


class PlanarImage(NamedTuple):
    """What a planar model sees: its answer, and the polar image that it saw.

    `confidence` is the probability that a surface is within 0.2 m, 0 where it is less
    than the least confidence.
    """

    confidence: Float[Array, "range azimuth"]
    radar: Float[Array, "range radar_azimuth"]


def one_pass(
    condition: Float[Array, "batch range radar_azimuth image"],
    params: Any,
    network: Network,
    noise: NoiseSpec,
) -> Float[Array, "batch range azimuth"]:
    """Return the image of one evaluation of the network for each condition."""
    denoise = conditional_denoiser(network, params, noise)(condition)
    shape = (len(condition), *LIDAR.shape, 1)
    return regression_estimate(denoise, shape, noise=noise)[..., 0]


def both_ways(
    condition: Float[Array, "batch range radar_azimuth image"],
    params: Any,
    network: Network,
    noise: NoiseSpec,
) -> tuple[Float[Array, "batch range azimuth"], Float[Array, " batch"]]:
    """Return the mean of the answers to conditions and to their mirror images.

    Also their `disagreement`.
    """
    both = jnp.concatenate([condition, condition[:, :, ::-1]])
    straight, mirrored = jnp.split(one_pass(both, params, network, noise), 2)
    mirrored = mirrored[:, :, ::-1]
    return (straight + mirrored) / 2, disagreement(straight, mirrored)


@jax.jit
def plane_image(
    condition: Float[Array, "range azimuth image"],
    model: PlanarModel,
    *,
    least_confidence: float | Float[Array, ""] | None = None,
) -> PlanarImage:
    """Return the model's answer to one condition; `vmap` it.

    Pixels of less than `least_confidence` are 0, by default of less than the model's
    share of the `expected_f_score`. So are all without an echo in the newest image.
    Raises ValueError for another shape.
    """
    spec = model.spec
    if condition.shape != spec.condition_shape:
        raise ValueError(
            f"condition has shape {condition.shape}, the model needs [range, azimuth, "
            f"image] = {spec.condition_shape}: one condition, or another model's?"
        )
    found = both_ways(condition[None], model.params, spec.network, spec.noise)
    (value,), (apart,) = found
    confidence = scaled(frequency(value, model.confidence), apart, model.scaling)
    confidence = jnp.where(value > FAINT, confidence, 0.0)  # no table covers others
    least = least_confidence
    if least is None:
        least = default_least(confidence, model.least_share)
    newest = condition[..., 0]
    kept = (confidence >= least) & newest.any()
    return PlanarImage(jnp.where(kept, confidence, 0.0), newest)


@jax.jit
def plane_cloud(
    image: PlanarImage,
    points: PointCloud,
    model: PlanarModel,
    *,
    least_confidence: float | Float[Array, ""] | None = None,
) -> PointCloud:
    """Return the cloud of an image, and of what is around the radar's points.

    It begins with a point in the middle of each pixel; those of confidence 0 are not
    valid. Then come the `plane_surroundings` of the radar's points, if the model has a
    table of their confidence; those of less than `least_confidence`, by default than a
    share of their own `expected_f_score`, are not valid. Pixels that are near none of
    them need the model's `least_alone` confidence, unless `least_confidence` was asked
    of all. The points have height 0 and no velocity.
    """
    xyz = jnp.asarray(LIDAR.xyz.reshape(-1, 3), jnp.float32)
    confidence = image.confidence.ravel()
    cloud = PointCloud(xyz, confidence > 0, confidence=confidence)
    if (echoes := model.echoes) is None:
        return cloud
    around = plane_surroundings(points)
    found = jnp.where(around.valid, frequency(around.confidence, echoes), 0.0)
    least = least_confidence
    if least is None:
        least = default_least(found, model.echo_share)
    kept = around.valid & (found >= least)
    added = PointCloud(around.xyz, kept, confidence=jnp.where(kept, found, 0.0))
    if least_confidence is None:
        places = jax.lax.optimization_barrier(xyz)  # XLA would take 2 s to fold them
        sure = near_points(places, added) | (confidence >= model.least_alone)
        valid, confidence = cloud.valid & sure, jnp.where(sure, confidence, 0.0)
        cloud = PointCloud(xyz, valid, confidence=confidence)
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), cloud, added)
