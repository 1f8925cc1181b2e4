"""Options of preparation, in Python and in a user's TOML file."""

import dataclasses
import math
from pathlib import Path

from jradar.errors import UsageError
from jradar.fields import typed_fields
from jradar.lidar import LidarSpec
from jradar.radar import PointSpec
from jradar.recordings.text_files import toml


@dataclasses.dataclass(frozen=True)
class PrepareSpec:
    """Options of preparation; the manifest of the records contains them.

    The condition uses nearly every cell (`false_alarm_rate` close to 1, section III-A).
    The visibility filter of the LiDAR trusts only points that are detected at
    `visible_false_alarm_rate`, with directions by "fft". Where the radar sends points,
    these are the condition's and all are trusted, so neither option is used. Raises
    ValueError for values that cannot be used.
    """

    points: PointSpec = PointSpec(false_alarm_rate=1.0)  # of the condition
    visible_false_alarm_rate: float = 1e-3
    tolerance_s: float = 0.05  # between a radar frame and its LiDAR scan
    block: int = 32  # frames in a shard
    lidar: LidarSpec = LidarSpec()

    def __post_init__(self):
        """Refuse values that cannot be used, naming the field."""
        if not 0 < (rate := self.visible_false_alarm_rate) <= 1:
            raise ValueError(
                f"visible_false_alarm_rate = {rate}, expected 0 < rate <= 1"
            )
        if not 0 <= self.tolerance_s < math.inf:
            raise ValueError(f"tolerance_s = {self.tolerance_s}, expected 0 or more")
        if self.block < 1:
            raise ValueError(f"block = {self.block}, expected 1 or more frames")

    @property
    def visible_points(self) -> PointSpec:
        """Options of the points that the visibility filter trusts."""
        rate = self.visible_false_alarm_rate
        return dataclasses.replace(self.points, false_alarm_rate=rate, angles="fft")

    @classmethod
    def from_toml(cls, path: Path | str) -> "PrepareSpec":
        """Return the fields in a TOML file; its tables are [points] and [lidar].

        Raises UsageError for unknown fields and for values that cannot be used.
        """
        try:
            return cls(**typed_fields(cls, toml(path)))
        except UsageError:
            raise
        except ValueError as error:
            raise UsageError(f"{path}: {error}") from error
