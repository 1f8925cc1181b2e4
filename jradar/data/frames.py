"""One radar frame and its LiDAR scan to what a record holds (sections III-A, V-A)."""

import dataclasses
import difflib
import functools
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from jradar.data.matching import Matches, match_nearest
from jradar.data.records import PreparedFrame
from jradar.lidar import LidarSpec, LidarSteps, interpolate_poses, preprocess
from jradar.radar import (
    Cells,
    PointSpec,
    RadarSpec,
    all_cells,
    cell_points,
    detect,
)
from jradar.recordings.recording import Recording, calibrated_cube
from jradar.recordings.text_files import toml
from jradar.types import PointCloud


@dataclasses.dataclass(frozen=True)
class PrepareSpec:
    """How frames are prepared; the manifest holds it.

    The visibility filter needs radar points that can be trusted, so it has a detection
    rate of its own; the condition's approaches 1 (section III-A). `angles` is how the
    directions of the cells are found, "fft" or "music"; those of the filter, and so the
    truth, are always found by FFT.
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
    block: int = 32  # frames of a shard
    lidar: LidarSpec = LidarSpec()

    @classmethod
    def from_toml(cls, path: Path | str) -> "PrepareSpec":
        """The fields in a TOML file, those of the LiDAR in its table [lidar].

        Raises ValueError for an unknown field, naming the nearest.
        """
        values = toml(path)
        lidar = _known(path, values.pop("lidar", {}), LidarSpec)
        return cls(**_known(path, values, cls), lidar=LidarSpec(**lidar))


def _known(path, values: Any, spec: Any) -> dict[str, Any]:
    """The values as fields of `spec`, lists as tuples."""
    names = [field.name for field in dataclasses.fields(spec)]
    for name in values:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1) or [", ".join(names)]
            raise ValueError(f"{path}: unknown field {name!r}, expected {near[0]}")
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


def matches_of(recording: Recording, spec: PrepareSpec) -> Matches:
    """The recording's matched frames; ValueError where it has no LiDAR or no times."""
    lidar, cubes = recording.lidar, recording.cubes
    if lidar is None or lidar.stamps is None or cubes.stamps is None:
        lacks = "no LiDAR" if lidar is None else "no time stamps"
        raise ValueError(
            f"{recording.path} has {lacks}: training pairs need both sensors and their "
            "times; describe the recording in a capture.toml"
        )
    span = (-np.inf, np.inf)
    if (poses := recording.poses) is not None:
        span = (float(poses.stamps[0]), float(poses.stamps[-1]))
    return match_nearest(
        cubes.stamps, lidar.stamps, tolerance_s=spec.tolerance_s, span=span
    )


def prepare_frame(
    recording: Recording, radar_index: int, lidar_index: int, spec: PrepareSpec
) -> tuple[PreparedFrame, LidarSteps, Float[np.ndarray, "echo 3"]]:
    """One radar frame with its LiDAR scan, on the host, and what decided its truth.

    That is every step of the LiDAR's preparation, and the radar points that it trusts.
    """
    cubes, lidar = recording.cubes, recording.lidar
    if lidar is None or lidar.stamps is None or cubes.stamps is None:
        raise ValueError(f"{recording.path} lacks a LiDAR or the times of its sensors")
    stamp = float(cubes.stamps[radar_index])
    lidar_stamp = float(lidar.stamps[lidar_index])
    cube = calibrated_cube(recording, radar_index)
    cells, cloud, trusted = radar_side(
        cube, recording.coupling, recording.radar, spec, recording.range_bias_m
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


def sensor_poses(
    recording: Recording, stamp: float, lidar_stamp: float
) -> tuple[np.ndarray, np.ndarray]:
    """World from radar and world from LiDAR, each at its own time, on the host.

    Without a trajectory the rig stands still, and the world is its base.
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
    cube, coupling, radar: RadarSpec, spec: PrepareSpec, range_bias_m: float
) -> tuple[Cells, PointCloud, PointCloud]:
    """Cells of a cube, the condition's cloud and that of the visibility filter."""
    points = PointSpec(
        detector=spec.detector,
        guard=spec.guard,
        train=spec.train,
        capacity=spec.capacity,
        flip_azimuth=spec.flip_azimuth,
        flip_elevation=spec.flip_elevation,
        angles=spec.angles,
    ).fitted(radar)
    cells = all_cells(cube, radar, points=points, coupling=coupling)
    of_filter = cells
    if spec.angles != "fft":
        by_fft = dataclasses.replace(points, angles="fft")
        of_filter = all_cells(cube, radar, points=by_fft, coupling=coupling)

    def cloud(cells, rate):
        at_rate = dataclasses.replace(points, false_alarm_rate=rate)
        mask = detect(cells.power, radar, points=at_rate)
        return cell_points(
            cells, mask, radar, points=points, range_bias_m=range_bias_m
        )

    return (
        cells,
        cloud(cells, spec.false_alarm_rate),
        cloud(of_filter, spec.visible_false_alarm_rate),
    )
