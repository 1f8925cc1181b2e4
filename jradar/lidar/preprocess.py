"""LiDAR scan to ground truth that the radar could have seen (V-A.3), on the host.

    scan -> radar's frame -> shared field of view -> no floor -> no ceiling -> visible

Each step is a function; `preprocess` chains them and keeps every mask.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jradar.lidar.align import returns, shared_field_of_view, transform
from jradar.lidar.ground import ceiling_mask, ground_mask
from jradar.lidar.visible import visible_mask


@dataclasses.dataclass(frozen=True)
class LidarSpec:
    """How scans are prepared; lengths in metres, angles (lowest, highest) in radians.

    `sensor_height_m` is the height of the radar above the floor; None finds it in each
    scan.
    """

    azimuth: tuple[float, float] = (-math.pi / 3, math.pi / 3)
    elevation: tuple[float, float] = (-math.pi / 9, math.pi / 9)
    min_range_m: float = 0.3
    max_range_m: float = 12.0
    sensor_height_m: float | None = None
    thickness_m: float = 0.08
    eps_m: float = 0.5
    min_points: int = 5
    voxel_m: float = 0.15
    max_points: int = 8000

    def __post_init__(self):
        """Refuse empty intervals and lengths that are not positive."""
        for name in ("azimuth", "elevation"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = ({low}, {high}), expected lowest < highest")
        if not 0 <= self.min_range_m < self.max_range_m < math.inf:
            raise ValueError(
                f"min_range_m = {self.min_range_m}, max_range_m = {self.max_range_m}: "
                "expected 0 <= nearest < farthest"
            )
        for name in ("sensor_height_m", "thickness_m", "eps_m", "min_points"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"{name} = {value}, expected more than 0")
        if not 0 <= self.voxel_m < math.inf or self.max_points < 1:
            raise ValueError(
                f"voxel_m = {self.voxel_m}, max_points = {self.max_points}: expected "
                "0 or more metres (0 is off) and 1 or more points"
            )


class LidarSteps(NamedTuple):
    """A scan in the radar's frame, missing returns as NaN, and a mask for each step.

    `ground`, `ceiling` and `visible` are disjoint parts of `in_view`.
    """

    xyz: Float[np.ndarray, "point 3"]
    in_view: Bool[np.ndarray, " point"]
    ground: Bool[np.ndarray, " point"]
    ceiling: Bool[np.ndarray, " point"]
    visible: Bool[np.ndarray, " point"]


def preprocess(
    lidar_xyz: Float[np.ndarray, "point 3"],
    radar_xyz: Float[np.ndarray, "echo 3"],
    *,
    radar_from_lidar: Float[np.ndarray, "4 4"],
    spec: LidarSpec,
) -> LidarSteps:
    """Apply all steps to one scan; the ground truth is `steps.xyz[steps.visible]`.

    `lidar_xyz` is in the LiDAR's frame, `radar_xyz` in the radar's. The result depends
    on the arguments only.
    """
    xyz, in_view = aligned(lidar_xyz, radar_from_lidar=radar_from_lidar, spec=spec)
    reach = {"max_range_m": spec.max_range_m, "thickness_m": spec.thickness_m}
    ground = ground_mask(
        xyz, among=in_view, sensor_height_m=spec.sensor_height_m, **reach
    )
    ceiling = ceiling_mask(xyz, among=in_view & ~ground, **reach)
    upright = np.flatnonzero(in_view & ~ground & ~ceiling)
    visible = np.zeros(len(xyz), bool)
    visible[upright] = visible_mask(
        xyz[upright],
        radar_xyz,
        eps_m=spec.eps_m,
        min_points=spec.min_points,
        voxel_m=spec.voxel_m,
        max_points=spec.max_points,
    )
    return LidarSteps(xyz, in_view, ground, ceiling, visible)


def aligned(
    lidar_xyz: Float[np.ndarray, "point 3"],
    *,
    radar_from_lidar: Float[np.ndarray, "4 4"],
    spec: LidarSpec,
) -> tuple[Float[np.ndarray, "point 3"], Bool[np.ndarray, " point"]]:
    """Return a scan in the radar's frame, and which points are in the field of view.

    Missing returns become NaN.
    """
    xyz = np.where(returns(lidar_xyz)[:, None], lidar_xyz, np.nan)
    xyz = transform(radar_from_lidar, xyz.astype(lidar_xyz.dtype))
    in_view = shared_field_of_view(
        xyz,
        azimuth=spec.azimuth,
        elevation=spec.elevation,
        max_range_m=spec.max_range_m,
        min_range_m=spec.min_range_m,
    )
    return xyz, in_view
