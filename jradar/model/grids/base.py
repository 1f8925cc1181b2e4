"""What a kind of model adds to the network: its condition, its answer and its points.

    samples, points --condition--> condition --answer--> image --cloud--> PointCloud

A grid is static: it shapes the computation. The rest of a model is the same for all
kinds, and stands in `jradar.model`.
"""

import abc
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

from jaxtyping import Array, Bool, Float, Key

from jradar.diffusion import NoiseSpec
from jradar.diffusion.precondition import ConditionalDenoiser
from jradar.errors import UsageError
from jradar.metrics import NEAR_M
from jradar.model.tables import Tables
from jradar.radar import RadarSpec
from jradar.range_image import ConfidenceTable, ImageSpec
from jradar.types import PointCloud

Answer = Callable[..., Any]  # from a `Question`, a grid and options to an image


class Question(NamedTuple):
    """What a network is asked: to answer one condition."""

    key: Key[Array, ""]
    denoise: ConditionalDenoiser
    condition: Float[Array, "row column channel"]
    noise: NoiseSpec
    temperature: float  # of a single sample


class Grid(abc.ABC):
    """A kind of model. Its subclasses are frozen dataclasses."""

    kind: ClassVar[str]  # as model files name it
    methods: ClassVar[Mapping[str, Answer]]  # how a network answers, by name
    of_frames: ClassVar[bool] = True  # False: its condition is not that of a frame

    @property
    @abc.abstractmethod
    def image_shape(self) -> tuple[int, int, int]:
        """The shape of what the network draws, [row, column, channel]."""

    @property
    @abc.abstractmethod
    def condition_shape(self) -> tuple[int, int, int]:
        """The shape of what the network is given, [row, column, channel]."""

    def check(self, shape: tuple[int, ...]) -> None:
        """Raise ValueError for a condition of another shape."""
        if shape != self.condition_shape:
            raise ValueError(
                f"condition has shape {shape}, the model needs [row, column, channel] "
                f"= {self.condition_shape}: one condition, or another model's?"
            )

    def answer(self, method: str, asked: Question, **sampling: Any) -> Any:
        """Return the network's image of a condition; `sampling` is that of `draw`."""
        return self.methods[method](asked, self, **sampling)

    @abc.abstractmethod
    def calibrated(self, image: Any, tables: Tables) -> Any:
        """Return an image whose confidence is the frequency of right points."""

    @abc.abstractmethod
    def kept(self, image: Any, least: Any, tables: Tables, condition: Any) -> Any:
        """Return an image without unsure pixels; None takes `least` of the tables."""


class FrameGrid(Grid):
    """A grid of models that turn a radar's frame into a cloud."""

    history: int = 1  # frames whose images make a condition

    @property
    @abc.abstractmethod
    def view(self) -> ImageSpec:
        """The field of view of its clouds."""

    @abc.abstractmethod
    def condition(
        self, samples: Any, points: PointCloud, radar: RadarSpec | None
    ) -> Float[Array, "row column channel"]:
        """Return the condition of one frame: of calibrated samples, or of points.

        `samples` and `radar` are None where only points are known. Raises UsageError
        for a grid that needs samples.
        """

    @abc.abstractmethod
    def features(
        self, condition: Float[Array, "row column channel"]
    ) -> Float[Array, " feature"]:
        """Return what describes a condition for a `TrustTable`."""

    @abc.abstractmethod
    def least(self, confidence: Float[Array, "..."], table: ConfidenceTable) -> Any:
        """Return the confidence that points of this frame must have."""

    @abc.abstractmethod
    def cloud(self, image: Any, points: PointCloud) -> PointCloud:
        """Return a point for each pixel; pixels that show nothing are not valid."""

    @abc.abstractmethod
    def surroundings(self, points: PointCloud) -> PointCloud:
        """Return points around the radar's, with the crowding as their confidence."""

    @abc.abstractmethod
    def near(
        self, cloud: PointCloud, points: PointCloud, around: PointCloud | None
    ) -> Bool[Array, " point"]:
        """Return which points of a cloud the radar's points support."""

    @abc.abstractmethod
    def pictured(self, image: Any, shown: Any) -> dict[str, Any]:
        """Return the image as arrays to save, by name, where `shown` is True."""

    def compared(self, cloud: PointCloud) -> PointCloud:
        """Return the part of a cloud, or of a LiDAR's scan, that scores compare."""
        return cloud

    @property
    def near_m(self) -> float:
        """The distance within which a point is right."""
        return NEAR_M

    @property
    def caution(self) -> str:
        """What is never right about the heights or angles of these clouds, or ""."""
        return ""


def no_draws(sampling: Mapping[str, Any], why: str) -> None:
    """Raise UsageError for options of samplers."""
    if sampling:
        raise UsageError(f"{', '.join(sampling)}: {why}, so leave these options out")
