"""Options of preparation, in Python and in a user's TOML file."""

import dataclasses
import math
from pathlib import Path

from jradar.errors import UsageError
from jradar.files import typed_fields
from jradar.lidar import LidarSpec
from jradar.radar import PointSpec
from jradar.recordings.text_files import toml


@dataclasses.dataclass(frozen=True)
class PrepareSpec:
    """Options of preparation; the manifest of the records contains them.

    The condition uses nearly every cell (`false_alarm_rate` close to 1, section III-A).
    The visibility filter of the LiDAR trusts only points that are detected at
    `visible_false_alarm_rate`. `angles` is how directions are found for the condition,
    as in `PointSpec`; the filter always uses "fft". Raises ValueError for values that
    cannot be used.
    """

    capacity: int = 1024  # points of the radar cloud
    detector: str = "os"
    false_alarm_rate: float = 1.0
    visible_false_alarm_rate: float = 1e-3
    guard: tuple[int, int] = PointSpec.guard  # cells in (doppler, range)
    train: tuple[int, int] = PointSpec.train
    angles: str = "fft"
    flip_azimuth: bool = False
    flip_elevation: bool = False
    remove_interference: bool = False  # crossing chirps of other radars
    tolerance_s: float = 0.05  # between a radar frame and its LiDAR scan
    block: int = 32  # frames in a shard
    lidar: LidarSpec = LidarSpec()

    def __post_init__(self):
        """Refuse values that cannot be used, naming the field."""
        _ = self.points  # checks its own fields
        if not 0 < (rate := self.visible_false_alarm_rate) <= 1:
            raise ValueError(
                f"visible_false_alarm_rate = {rate}, expected 0 < rate <= 1"
            )
        if not 0 <= self.tolerance_s < math.inf:
            raise ValueError(f"tolerance_s = {self.tolerance_s}, expected 0 or more")
        if self.block < 1:
            raise ValueError(f"block = {self.block}, expected 1 or more frames")

    @property
    def points(self) -> PointSpec:
        """Options of the condition's points."""
        return PointSpec(
            capacity=self.capacity,
            detector=self.detector,
            false_alarm_rate=self.false_alarm_rate,
            guard=self.guard,
            train=self.train,
            angles=self.angles,
            flip_azimuth=self.flip_azimuth,
            flip_elevation=self.flip_elevation,
            remove_interference=self.remove_interference,
        )

    @property
    def visible_points(self) -> PointSpec:
        """Options of the points that the visibility filter trusts."""
        rate = self.visible_false_alarm_rate
        return dataclasses.replace(self.points, false_alarm_rate=rate, angles="fft")

    @classmethod
    def from_toml(cls, path: Path | str) -> "PrepareSpec":
        """Return the fields in a TOML file; its table [lidar] is the `LidarSpec`.

        Raises UsageError for unknown fields and for values that cannot be used.
        """
        try:
            return cls(**typed_fields(cls, toml(path)))
        except UsageError:
            raise
        except ValueError as error:
            raise UsageError(f"{path}: {error}") from error
