"""The grid of range images: a frame's points in, a range for each direction out.

points --condition_image--> condition [row, column, channel]       64 x 64
--network--> RangeImage [row, column]                              128 x 512
"""

import dataclasses
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jradar.model.grids.base import FrameGrid
from jradar.model.grids.view.answers import METHODS
from jradar.range_code import CODECS
from jradar.range_image import (
    CHANNELS,
    OF_HISTORY,
    ImageSpec,
    RangeImage,
    condition_features,
    condition_image,
    confident,
    crowding,
    frequency,
    image_cloud,
    near_echo,
    surroundings,
    velocity_image,
)

MOST_SURROUNDED = 1024  # points: as many as one dense frame has


@dataclasses.dataclass(frozen=True)
class ViewGrid(FrameGrid):
    """Range images of one field of view: conditions are `coarse`, answers `fine`."""

    kind: ClassVar[str] = "view"
    methods = METHODS

    coarse: ImageSpec
    fine: ImageSpec
    num_slices: int
    codec: str
    validity_threshold: float = 0.0
    channels: tuple[str, ...] = CHANNELS  # of each slice of a condition

    def __post_init__(self):
        if self.channels not in (CHANNELS, OF_HISTORY):
            raise ValueError(
                f"channels = {self.channels}, expected {CHANNELS} or {OF_HISTORY}"
            )
        if self.codec not in CODECS:
            raise ValueError(f"codec = {self.codec!r}, expected one of {[*CODECS]}")

    @property
    def view(self) -> ImageSpec:
        """The field of view of its clouds."""
        return self.fine

    @property
    def near_m(self) -> float:
        """What is near in the view: 0.2 m of 12."""
        return self.fine.near_m

    @property
    def image_shape(self) -> tuple[int, int, int]:
        """Range and validity of each pixel."""
        return (*self.fine.shape, 2)

    @property
    def condition_shape(self) -> tuple[int, int, int]:
        """The channels of each slice, for each coarse pixel."""
        return (*self.coarse.shape, len(self.channels) * self.num_slices)

    def condition(self, samples, points, radar):
        """Return the points as range images; samples are not used."""
        slices = {"num_slices": self.num_slices, "channels": self.channels}
        return condition_image(points, self.coarse, **slices)

    def features(self, condition):
        """Return the share of pixels and the power of each slice."""
        return condition_features(condition, channels=self.channels)

    def calibrated(self, image: RangeImage, tables) -> RangeImage:
        """Return the image with the table's confidence, if it has any."""
        if image.confidence is None:
            return image
        found = frequency(image.confidence, tables.confidence)
        return image._replace(confidence=found)

    def kept(self, image: RangeImage, least, tables, condition) -> RangeImage:
        """Return the sure pixels; none without a radar point in the condition."""
        image = confident(image, tables.confidence.least if least is None else least)
        return jax.tree.map(lambda value: jnp.where(condition.any(), value, 0.0), image)

    def least(self, confidence, table):
        """Return the table's least confidence, which is the same for all frames."""
        return table.least

    def cloud(self, image: RangeImage, points):
        """Return a point for each range, with the velocities of the radar's points."""
        cloud = image_cloud(image, self.fine)
        if points.velocity is None:
            return cloud
        slices = {"num_slices": self.num_slices}
        velocity = velocity_image(image.range_m, points, self.coarse, **slices)
        return cloud._replace(velocity=velocity.ravel())

    def surroundings(self, points):
        """Return a disc of points around each of the radar's newest points."""
        points = jax.tree.map(lambda column: column[:MOST_SURROUNDED], points)
        crowded = points._replace(confidence=crowding(points, self.fine))
        return surroundings(crowded, self.fine)

    def near(self, cloud, points, around):
        """Return which points are near an echo of 6 dB or more."""
        return near_echo(cloud, points, self.fine)

    def pictured(self, image: RangeImage, shown) -> dict[str, Any]:
        """Return the range image in metres."""
        return {"range_image": np.where(shown, image.range_m, 0)}
