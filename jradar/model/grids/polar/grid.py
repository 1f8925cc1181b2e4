"""The grid of polar images: clouds in the plane of one row of antennas.

A radar with one row of antennas measures no elevation. What it can measure is where
surfaces are in its plane. The polar image of a frame, formed as in RadarHD (Prabhakara
et al. 2023), becomes an image of occupancy, and this a cloud of points at height 0.

    samples --polar_image--> condition [range, azimuth, image]    256 x 64 pixels
    --network--> PolarImage [range, azimuth]                      256 x 512
"""

import dataclasses
import functools
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads `special` when it is first used

from jradar.errors import UsageError
from jradar.model.grids.base import FrameGrid
from jradar.model.grids.polar.answers import METHODS, PolarImage
from jradar.model.grids.polar.axes import LIDAR, MAX_RANGE_M, RADAR, in_view
from jradar.model.grids.polar.image import image_features, polar_image
from jradar.model.grids.polar.truth import HALF_HEIGHT_M
from jradar.model.mirror import least_confidence, scaled
from jradar.range_image import ImageSpec, count_near, crowding, frequency
from jradar.range_image.evidence import spread_out
from jradar.types import PointCloud

MOST_IMAGES = 256  # in a condition
FAINT = 0.02  # value of a pixel that is never a point
AROUND = 10  # points for each point of the radar
WIDE_M = 0.15  # their deviation to the sides
DEEP_M = 0.05  # and along the line of sight
VIEW = ImageSpec(64, 64, max_range_m=MAX_RANGE_M)  # near means a share of the range
HEIGHTS = "height is not measured: all points lie at height 0"


@dataclasses.dataclass(frozen=True)
class PolarGrid(FrameGrid):
    """Polar images of RadarHD's view; a condition holds the last `history` of them."""

    kind: ClassVar[str] = "polar"
    methods = METHODS

    history: int = 1

    def __post_init__(self):
        if not 1 <= self.history <= MOST_IMAGES:
            raise ValueError(f"history = {self.history}, expected 1 to {MOST_IMAGES}")

    @property
    def view(self) -> ImageSpec:
        """The field of view of its clouds."""
        return VIEW

    @property
    def image_shape(self) -> tuple[int, int, int]:
        """The occupancy of each pixel."""
        return (*LIDAR.shape, 1)

    @property
    def condition_shape(self) -> tuple[int, int, int]:
        """Polar images, [range, azimuth, image]."""
        return (*RADAR.shape, self.history)

    def condition(self, samples, points, radar):
        """Return the polar image of a frame, which also stands for those before it."""
        if samples is None or radar is None:
            raise UsageError(
                "a model of polar images sees a radar's samples, not its points: use "
                "`enhance` with the cube, or a model of range images such as jradar-sim"
            )
        image = polar_image(samples, radar)
        return jnp.stack([image] * self.history, -1)

    def features(self, condition):
        """Return the lit share and the brightness of the newest image."""
        return image_features(condition[..., 0])

    def calibrated(self, image: PolarImage, tables) -> PolarImage:
        """Return the image with the table's confidence, less where answers disagree."""
        found = frequency(image.confidence, tables.confidence)
        if tables.scaling is not None:
            found = scaled(found, image.disagreement, tables.scaling)
        # No table covers fainter pixels.
        found = jnp.where(image.confidence > FAINT, found, 0.0)
        return image._replace(confidence=found)

    def kept(self, image: PolarImage, least, tables, condition) -> PolarImage:
        """Return the sure pixels; none without an echo in the newest image."""
        found = image.confidence
        least = self.least(found, tables.confidence) if least is None else least
        kept = (found >= least) & image.radar.any()
        return image._replace(confidence=jnp.where(kept, found, 0.0))

    def least(self, confidence, table):
        """Return the table's share of the F-score expected of this frame."""
        return least_confidence(confidence, jnp.asarray(table.least))

    def cloud(self, image: PolarImage, points) -> PointCloud:
        """Return a point in the middle of each pixel; no velocities."""
        xyz = jnp.asarray(LIDAR.xyz.reshape(-1, 3), jnp.float32)
        confidence = image.confidence.ravel()
        return PointCloud(xyz, confidence > 0, confidence=confidence)

    def surroundings(self, points) -> PointCloud:
        """Return a line of points around each of the radar's that lies in its plane.

        Points of the plane are at most 0.3 m above or below the radar. The points
        around them have height 0.
        """
        seen = self.compared(points)
        flat = PointCloud(seen.xyz, seen.valid)
        flat = flat._replace(confidence=crowding(flat, VIEW, axes=2))
        return spread_out(flat, _line(), in_view)

    def near(self, cloud, points, around):
        """Return which points have a point of `around` within 0.5 m."""
        if around is None:
            return jnp.ones(len(cloud.valid), bool)
        # Without the barrier, XLA would take 2 s to fold the places of all pixels.
        places = jax.lax.optimization_barrier(cloud.xyz)
        seen = around.xyz[:, :2]
        return count_near(places[:, :2], seen, around.valid, VIEW) > 0

    def pictured(self, image: PolarImage, shown) -> dict[str, Any]:
        """Return the polar image that the network saw, and its answer."""
        seen = np.where(shown, image.confidence, 0)
        return {"polar_image": np.asarray(image.radar), "occupancy": seen}

    def compared(self, cloud):
        """Return the points at most 0.3 m above or below the plane, in the plane."""
        seen = (
            cloud.valid & (abs(cloud.xyz[:, 2]) <= HALF_HEIGHT_M) & in_view(cloud.xyz)
        )
        flat = cloud.xyz * np.asarray((1.0, 1.0, 0.0), np.float32)
        return cloud._replace(xyz=flat, valid=seen)

    @property
    def caution(self) -> str:
        """The sentence that heights are not measured."""
        return HEIGHTS


@functools.cache
def _line():
    """Return steps [point, 3] ahead, left and up: a Gaussian, evenly sampled."""
    wide = WIDE_M * scipy.special.ndtri((np.arange(AROUND) + 0.5) / AROUND)
    deep = DEEP_M * np.where(np.arange(AROUND) % 2, 1, -1)
    return np.stack([deep, wide, np.zeros(AROUND)], -1)
