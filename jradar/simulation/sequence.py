"""A sequence: a scene, what the rig's sensors record on their way through it, on disk.

Streams have clocks of their own: they start apart, and their stamps jitter. A stamp is
the time of a frame's first chirp, or of a scan's first column; half a turn (50 ms)
later the scan looks ahead. Everything is a function of family and seed; a folder is
there when it is complete, or never.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.files import atomic_path
from jradar.radar import RadarSpec
from jradar.simulation import coloradar_writer as files
from jradar.simulation.layouts import make_scene
from jradar.simulation.motion import STEP_S
from jradar.simulation.radar import (
    Hardware,
    frame_paths,
    make_hardware,
    sample_frame,
)
from jradar.simulation.reflectors import Reflectors, find_reflectors
from jradar.simulation.rig import base_from, sensor_pose
from jradar.simulation.scanner import ouster_rays, scan
from jradar.simulation.scene import Scene

EPOCH_S = 1_608_552_000.0  # 21 December 2020, when ColoRadar's first runs were made
GRAVITY = np.array([0.0, 0.0, 9.80665])


class Clock(NamedTuple):
    """A stream's rate, where in a period it starts, and how its stamps jitter."""

    rate_hz: float
    start_s: float
    jitter_s: float


CLOCKS = {
    "single_chip": Clock(10.0, 0.100, 0.4e-3),
    "cascade": Clock(5.0, 0.122, 0.4e-3),
    "lidar": Clock(10.0, 0.063, 0.2e-3),
    "groundtruth": Clock(10.0, 0.0, 0.1e-3),
    "imu": Clock(300.0, 0.0, 0.05e-3),
}
RADARS = {"single_chip": RadarSpec.awr1843, "cascade": RadarSpec.cascade}
SENSORS = {
    "single_chip": ("single_chip",),
    "cascade": ("cascade",),
    "both": ("single_chip", "cascade"),
}


class Setting(NamedTuple):
    """A scene with all that does not change while it is recorded."""

    scene: Scene
    reflectors: Reflectors
    seed: int
    radars: dict[str, tuple[RadarSpec, Hardware]]


def make_setting(family: str, seed: int, *, sensor: str = "single_chip") -> Setting:
    """The scene of a family and seed, and the radars: single_chip, cascade or both."""
    if sensor not in SENSORS:
        raise ValueError(f"sensor {sensor!r}, expected one of {', '.join(SENSORS)}")
    scene = make_scene(family, seed)
    specs = {name: RADARS[name]() for name in SENSORS[sensor]}
    radars = {name: (spec, make_hardware(name, spec)) for name, spec in specs.items()}
    return Setting(scene, find_reflectors(scene.bodies), seed, radars)


def stream_stamps(
    setting: Setting, stream: str, seconds: float
) -> Float[np.ndarray, " item"]:
    """Times of a stream's items in a recording that long, from its start."""
    clock = CLOCKS[stream]
    count = max(round(seconds * clock.rate_hz), 1)
    if stream in ("groundtruth", "imu"):  # these run on either side of the rest
        count += round(0.4 * clock.rate_hz)
    random = np.random.default_rng([setting.seed, *stream.encode()])
    stamps = clock.start_s + np.arange(count) / clock.rate_hz
    return np.round(stamps + clock.jitter_s * random.standard_normal(count), 6)


def radar_frames(setting: Setting, sensor: str, stamps: np.ndarray) -> Iterator:
    """int16 frames [tx, rx, chirp, sample, 2] of a radar, as JAX works them out."""
    radar, hardware = setting.radars[sensor]
    key = jax.random.fold_in(jax.random.key(setting.seed), len(sensor))
    for frame, time_s in enumerate(stamps):
        paths = frame_paths(
            setting.scene, setting.reflectors, sensor, float(time_s), radar
        )
        yield sample_frame(jax.random.fold_in(key, frame), paths, hardware, radar)


def lidar_scans(setting: Setting, stamps: np.ndarray) -> Iterator[np.ndarray]:
    """Scans [65536, 4] of the Ouster, float32."""
    directions, seconds = ouster_rays()
    for frame, time_s in enumerate(stamps):
        random = np.random.default_rng([setting.seed, 1, frame])
        platform = setting.scene.platform
        yield scan(random, setting.scene, platform, float(time_s), directions, seconds)


def simulate_sequence(
    family: str,
    seed: int,
    root: Path | str,
    *,
    frames: int = 50,
    sensor: str = "single_chip",
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Write `frames` radar frames of a scene as `root/FAMILY_SEED`, and `root/calib`.

    `sensor` is "single_chip", "cascade" or "both" (then `frames` counts the single
    chip's). `advance` is called after each frame. Returns the sequence's folder.
    """
    if frames < 1:
        raise ValueError(f"frames = {frames}, expected 1 or more")
    setting = make_setting(family, seed, sensor=sensor)
    first = SENSORS[sensor][0]
    seconds = frames / CLOCKS[first].rate_hz
    folder = Path(root) / setting.scene.name
    files.write_calib(Path(root) / "calib", _all_radars(setting))
    with atomic_path(folder) as scratch:
        streams = [_radar_stream(setting, s, seconds, scratch) for s in setting.radars]
        streams.append(_lidar_stream(setting, seconds, scratch))
        _write_motion(setting, seconds, scratch)
        while streams:  # a turn each, so that JAX and the rays work side by side
            streams = [stream for stream in streams if next(stream, None)]
            if streams:
                advance()
    return folder


def _all_radars(setting):
    """Both radars of the rig: the folder `calib` is the same for all recordings."""
    missing = {
        name: make() for name, make in RADARS.items() if name not in setting.radars
    }
    made = {name: (spec, make_hardware(name, spec)) for name, spec in missing.items()}
    return setting.radars | made


def _radar_stream(setting, sensor, seconds, scratch):
    """Write a radar's frames, one behind what JAX is working on."""
    stamps = stream_stamps(setting, sensor, seconds)
    folder = scratch / sensor / "adc_samples"
    files.write_stamps(folder, EPOCH_S + stamps)
    (folder / "data").mkdir()
    for k, frame in enumerate(radar_frames(setting, sensor, stamps)):
        yield True
        np.asarray(frame).astype("<i2").tofile(folder / "data" / f"frame_{k}.bin")


def _lidar_stream(setting, seconds, scratch):
    """Write the LiDAR's scans."""
    stamps = stream_stamps(setting, "lidar", seconds)
    files.write_stamps(scratch / "lidar", EPOCH_S + stamps)
    (scratch / "lidar" / "pointclouds").mkdir()
    for k, cloud in enumerate(lidar_scans(setting, stamps)):
        path = scratch / "lidar" / "pointclouds" / f"lidar_pointcloud_{k}.bin"
        cloud.astype("<f4").tofile(path)
        yield True


def _write_motion(setting, seconds, scratch):
    """True poses of the base, and the IMU."""
    platform = setting.scene.platform
    stamps = stream_stamps(setting, "groundtruth", seconds)
    xyz, turn = sensor_pose(platform, "base", stamps)
    files.write_stamps(scratch / "groundtruth", EPOCH_S + stamps)
    poses = np.column_stack([xyz, Rotation.from_matrix(turn).as_quat()])
    files.write_rows(scratch / "groundtruth" / "groundtruth_poses.txt", poses)

    stamps = stream_stamps(setting, "imu", seconds)
    files.write_stamps(scratch / "imu", EPOCH_S + stamps)
    files.write_rows(scratch / "imu" / "imu_data.txt", imu_records(setting, stamps))


def imu_records(
    setting: Setting, stamps: Float[np.ndarray, " item"]
) -> Float[np.ndarray, "item 6"]:
    """Specific force (m/s^2) and angular rate (rad/s) in the IMU frame, with noise."""
    platform, step = setting.scene.platform, 10 * STEP_S
    before, now, after = (
        sensor_pose(platform, "base", stamps + side) for side in (-step, 0.0, step)
    )
    force = (after[0] - 2 * now[0] + before[0]) / step**2 + GRAVITY
    change = Rotation.from_matrix(after[1] @ before[1].swapaxes(-1, -2))
    rate = change.as_rotvec() / (2 * step)
    to_imu = (now[1] @ base_from("imu")[:3, :3]).swapaxes(-1, -2)
    random = np.random.default_rng([setting.seed, 2])
    bias = random.normal(scale=[0.02] * 3 + [1e-3] * 3)
    noise = random.normal(scale=[0.03] * 3 + [3e-3] * 3, size=(len(stamps), 6))
    felt = [np.einsum("tij,tj->ti", to_imu, vector) for vector in (force, rate)]
    return np.concatenate(felt, -1) + bias + noise
