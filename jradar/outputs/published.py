"""What is published of a frame: its clouds, a picture of the echoes, and the poses."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact, UInt8

from jradar.lidar import interpolate_poses
from jradar.pipeline import Frame
from jradar.radar import RadarSpec, azimuth_map, range_doppler
from jradar.recordings import Recording, nearest_scan, radar_from_lidar
from jradar.types import PointCloud

FALLBACK_PERIOD_S = 0.1  # of frames, if neither times nor a period are known
SHOWN_DB = 50.0  # below the strongest echo; weaker ones are black
RADAR_FRAME, BASE_FRAME, LIDAR_FRAME = "radar", "base", "lidar"
ODOM_FRAME = "odom"  # fixed, in which the base moves
CLOUDS = ("radar", "enhanced", "lidar")  # names of clouds, with topics /NAME/points
VERDICT = "/enhanced/verdict"


class Published(NamedTuple):
    """One frame as writers take it. Points are in the radar's frame, in metres."""

    number: int
    stamp_s: float  # since 1970
    clouds: dict[str, PointCloud]  # by topic, such as "radar", "enhanced", "lidar"
    picture: UInt8[np.ndarray, "range azimuth"] | None = None
    base_from: dict[str, np.ndarray] = {}  # 4 x 4, of "radar" and "lidar" where known
    odom_from_base: np.ndarray | None = None  # 4 x 4, where the motion is known
    verdict: tuple[str, ...] = ()  # how far to trust the enhanced cloud, in sentences

    @property
    def transforms(self) -> list[tuple[str, str, np.ndarray]]:
        """The known transforms: parent frame, child frame, and the child's pose."""
        moving = [] if self.odom_from_base is None else [self.odom_from_base]
        return [
            *((ODOM_FRAME, BASE_FRAME, matrix) for matrix in moving),
            *((BASE_FRAME, child, matrix) for child, matrix in self.base_from.items()),
        ]

    @property
    def stamp_ns(self) -> int:
        """The time as ROS and MCAP count it."""
        return round(self.stamp_s * 1e9)


@functools.partial(jax.jit, static_argnames="radar")
def range_azimuth(
    cube: Inexact[Array, "tx rx chirp sample"], radar: RadarSpec
) -> UInt8[Array, "range azimuth"]:
    """Return `azimuth_map` as a picture: far is up, left is left.

    255 is the strongest echo of the frame, 0 is 50 dB or more below it.
    """
    above = azimuth_map(*range_doppler(cube), radar)
    level = 10 * jnp.log10(above / jnp.maximum(above.max(), 1e-30) + 1e-30)
    shade = jnp.clip(255 * (1 + level / SHOWN_DB), 0, 255)
    return jnp.where(above.max() > 0, shade, 0).astype(jnp.uint8)[::-1, ::-1]


def published(
    recording: Recording,
    frame: int,
    clouds: dict[str, PointCloud],
    picture: UInt8[np.ndarray, "range azimuth"] | None = None,
) -> Published:
    """Return a recorded frame as it is published, with its time and its sensors' poses.

    Without stamps, frames follow one another in the radar's frame period, or in 0.1 s.
    """
    stamps, period_s = recording.frames.stamps, recording.frame_period_s
    stamp_s = frame * (period_s or FALLBACK_PERIOD_S)
    if stamps is not None:
        stamp_s = float(stamps[frame])
    places, moved = sensor_places(recording), odom_from_base(recording, frame)
    return Published(frame, stamp_s, clouds, picture, places, moved)


def published_frame(recording: Recording, frame: Frame) -> Published:
    """Return an enhanced frame as it is published, with its LiDAR scan if any."""
    clouds = {"radar": frame.points, "enhanced": frame.cloud}
    if (lidar := nearest_scan(recording, frame.number)) is not None:
        clouds[LIDAR_FRAME] = lidar_cloud(lidar)
    picture = None
    if frame.samples is not None:
        picture = np.asarray(range_azimuth(frame.samples, recording.radar.spec))
    shown = published(recording, frame.number, clouds, picture)
    return shown._replace(verdict=frame.verdict)


def sensor_places(recording: Recording) -> dict[str, np.ndarray]:
    """Return the transforms to the base of those sensors whose place is known."""
    places = {RADAR_FRAME: recording.base_from_radar}
    if radar_from_lidar(recording) is not None:
        places[LIDAR_FRAME] = recording.base_from_lidar
    return {name: matrix for name, matrix in places.items() if matrix is not None}


def odom_from_base(recording: Recording, frame: int) -> np.ndarray | None:
    """Return the recorded pose of the base at the time of a frame; None if unknown."""
    stamps, poses = recording.frames.stamps, recording.poses
    if poses is None or stamps is None:
        return None
    try:
        (pose,) = interpolate_poses(poses, np.array([stamps[frame]]))
    except ValueError:  # a trajectory of one pose, or of times that do not rise
        return None
    return pose if np.isfinite(pose).all() else None


def lidar_cloud(xyz: Float[np.ndarray, "point 3"]) -> PointCloud:
    """Return LiDAR points, already in the radar's frame, as a cloud."""
    table = np.asarray(xyz, np.float32).reshape(-1, 3)
    return PointCloud(table, np.ones(len(table), bool))  # pyright: ignore
