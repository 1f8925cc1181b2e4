"""One radar frame and its LiDAR scan to a prepared frame (sections III-A, V-A)."""

import dataclasses
import difflib
import functools
import math
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.data.matching import Matches, match_nearest
from jradar.data.records import PreparedFrame
from jradar.errors import UsageError
from jradar.lidar import LidarSpec, LidarSteps, interpolate_poses, preprocess
from jradar.radar import (
    Cells,
    PointSpec,
    RadarSpec,
    all_cells,
    cell_points,
    detect,
)
from jradar.recordings.recording import Recording, Stream, calibrated_cube
from jradar.recordings.text_files import toml
from jradar.types import PointCloud


@dataclasses.dataclass(frozen=True)
class PrepareSpec:
    """Options of preparation; the manifest of the records contains them.

    The condition uses nearly every cell (`false_alarm_rate` close to 1, section III-A).
    The visibility filter of the LiDAR trusts only points that are detected at
    `visible_false_alarm_rate`. `angles` is how directions are found for the condition,
    "fft" or "music"; the filter always uses "fft". Raises ValueError for values that
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
    tolerance_s: float = 0.05  # between a radar frame and its LiDAR scan
    block: int = 32  # frames in a shard
    lidar: LidarSpec = LidarSpec()

    def __post_init__(self):
        """Refuse values that cannot be used, naming the field."""
        _ = self.points, self.visible_points
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
            values = toml(path)
        except ValueError as error:
            raise UsageError(str(error)) from error
        try:
            lidar = _fields(values.pop("lidar", {}), LidarSpec)
            return cls(**_fields(values, cls), lidar=LidarSpec(**lidar))
        except ValueError as error:
            raise UsageError(f"{path}: {error}") from error


def _fields(values: Any, spec: Any) -> dict[str, Any]:
    """The values of a TOML table as fields of `spec`, lists as tuples."""
    if not isinstance(values, dict):
        raise ValueError(f"lidar = {values!r}, expected a table [lidar]")
    defaults = {field.name: field.default for field in dataclasses.fields(spec)}
    for name, value in values.items():
        if name not in defaults:
            near = difflib.get_close_matches(name, defaults, 1) or [", ".join(defaults)]
            raise ValueError(f"unknown field {name!r}, expected {near[0]}")
        if not _is_like(value, defaults[name]):
            like = 1.0 if defaults[name] is None else defaults[name]
            like = [*like] if isinstance(like, tuple) else like
            raise ValueError(f"{name} = {value!r}, expected a value such as {like!r}")
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


def _is_like(value: Any, default: Any) -> bool:
    """Whether a TOML value has the type of a default; None stands for a number."""
    if isinstance(default, tuple):
        same_length = isinstance(value, list) and len(value) == len(default)
        return same_length and all(map(_is_like, value, default))
    if default is None or isinstance(default, float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return type(value) is type(default)


def matches_of(recording: Recording, spec: PrepareSpec) -> Matches:
    """Return the matched frames; raises ValueError without LiDAR or time stamps."""
    stamps, _, lidar_stamps = _timed(recording)
    span = (-np.inf, np.inf)
    if (poses := recording.poses) is not None:
        span = (float(poses.stamps[0]), float(poses.stamps[-1]))
    return match_nearest(stamps, lidar_stamps, tolerance_s=spec.tolerance_s, span=span)


def prepare_frame(
    recording: Recording, radar_index: int, lidar_index: int, spec: PrepareSpec
) -> tuple[PreparedFrame, LidarSteps, Float[np.ndarray, "echo 3"]]:
    """Prepare one radar frame with its LiDAR scan, on the host.

    Also returns the steps of the LiDAR's preparation and the radar points that the
    visibility filter trusted. Raises ValueError without LiDAR or time stamps.
    """
    stamps, lidar, lidar_stamps = _timed(recording)
    stamp, lidar_stamp = float(stamps[radar_index]), float(lidar_stamps[lidar_index])
    cells, cloud, trusted = radar_side(
        calibrated_cube(recording, radar_index),
        recording.radar,
        spec,
        coupling=recording.coupling,
        range_bias_m=recording.range_bias_m,
    )
    world_from_radar, world_from_lidar = sensor_poses(recording, stamp, lidar_stamp)
    trusted_xyz = np.asarray(trusted.xyz)[np.asarray(trusted.valid)]
    steps = preprocess(
        lidar[lidar_index][:, :3],
        trusted_xyz,
        radar_from_lidar=np.linalg.inv(world_from_radar) @ world_from_lidar,
        spec=spec.lidar,
    )
    known = recording.poses is not None
    frame = PreparedFrame(
        sequence=recording.name,
        frame=radar_index,
        stamp=stamp,
        lidar_stamp=lidar_stamp,
        world_from_radar=world_from_radar if known else np.full((4, 4), np.nan),
        cells=jax.tree.map(np.asarray, cells),
        radar=jax.tree.map(np.asarray, cloud),
        lidar_xyz=steps.xyz[steps.visible],
        range_bias_m=recording.range_bias_m,
    )
    return frame, steps, trusted_xyz


def _timed(recording: Recording) -> tuple[np.ndarray, Stream, np.ndarray]:
    """The radar's time stamps, the LiDAR's scans and their time stamps."""
    lidar, cubes = recording.lidar, recording.cubes
    if lidar is None or lidar.stamps is None or cubes.stamps is None:
        lacks = "no LiDAR" if lidar is None else "no time stamps"
        raise ValueError(
            f"{recording.path} has {lacks}: training pairs need both sensors and their "
            "times; describe the recording in a capture.toml"
        )
    return cubes.stamps, lidar, lidar.stamps


def sensor_poses(
    recording: Recording, stamp: float, lidar_stamp: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return world from radar and world from LiDAR, each at its own time, on the host.

    Without a trajectory the rig is at rest and its base is the world.
    """
    base = np.stack([np.eye(4)] * 2)
    if recording.poses is not None:
        base = interpolate_poses(recording.poses, np.array([stamp, lidar_stamp]))
        if not np.isfinite(base[1]).all():  # a scan just beyond the trajectory's end
            base[1] = base[0]
    mounted = [
        np.eye(4) if matrix is None else matrix
        for matrix in (recording.base_from_radar, recording.base_from_lidar)
    ]
    return base[0] @ mounted[0], base[1] @ mounted[1]


@functools.partial(jax.jit, static_argnames=("radar", "spec", "range_bias_m"))
def radar_side(
    cube: Complex[Array | np.ndarray, "tx rx chirp sample"],
    radar: RadarSpec,
    spec: PrepareSpec,
    *,
    coupling: Complex[Array | np.ndarray, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
) -> tuple[Cells, PointCloud, PointCloud]:
    """Return the cells, the condition's cloud and the visibility filter's cloud."""
    condition, trusted = spec.points.fitted(radar), spec.visible_points.fitted(radar)
    cells = all_cells(cube, radar, points=condition, coupling=coupling)
    trusted_cells = cells
    if condition.angles != trusted.angles:
        trusted_cells = all_cells(cube, radar, points=trusted, coupling=coupling)

    def cloud(cells, points):
        mask = detect(cells.power, radar, points=points)
        return cell_points(cells, mask, radar, points=points, range_bias_m=range_bias_m)

    return cells, cloud(cells, condition), cloud(trusted_cells, trusted)
