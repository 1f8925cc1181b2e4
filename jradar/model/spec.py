"""What a model is: parameters, and everything else about it."""

import dataclasses
import functools
from typing import Any

import jax

from jradar.diffusion import Network, NoiseSpec
from jradar.model.methods import METHODS
from jradar.radar import PointSpec, RadarSpec
from jradar.range_image import CalibrationSpec, ImageSpec, TrustSpec


@dataclasses.dataclass(frozen=True)
class ModelSpec:
    """Everything about a model except its parameters.

    `method` is how the network answers (`methods`). `purpose` is shown to users of the
    weights. Points of less than `least_confidence`, after `calibration`, are dropped.
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
    least_confidence: float = 0.375
    calibration: CalibrationSpec | None = None  # of the confidence
    other_radars: tuple[RadarSpec, ...] = ()  # of training, beside `radar`

    def __post_init__(self):
        """Refuse an unknown method, and a confidence that is no probability."""
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}, expected one of {[*METHODS]}")
        if not 0 <= self.least_confidence <= 1:
            raise ValueError(
                f"least_confidence = {self.least_confidence}, expected 0 to 1"
            )


@functools.partial(
    jax.tree_util.register_dataclass, data_fields=["params"], meta_fields=["spec"]
)
@dataclasses.dataclass(frozen=True)
class Model:
    """A trained network: a pytree whose leaves are the parameters."""

    params: Any
    spec: ModelSpec
