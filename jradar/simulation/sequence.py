"""A sequence on disk: what the sensors record while the rig moves through a scene.

Each stream has its own clock: it starts at its own time, and its stamps jitter. A stamp
is the time of a frame's first chirp, or of a scan's first column; the scanner looks
ahead half a rotation (50 ms) later. Family and seed determine every byte. The folder
appears when it is complete.
"""

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.files import atomic_folder
from jradar.radar import RadarSpec
from jradar.simulation import coloradar_writer as files
from jradar.simulation.hardware.hardware import (
    Hardware,
    make_hardware,
    make_unit_hardware,
    sample_frame,
)
from jradar.simulation.paths.clutter import diffuse_clutter
from jradar.simulation.paths.line_of_sight import joined
from jradar.simulation.paths.propagation import radar_paths
from jradar.simulation.paths.reflectors import Reflectors, find_reflectors
from jradar.simulation.rig import base_from, sensor_pose, viewpoint
from jradar.simulation.scanner import (
    MID360_POINTS,
    OUSTER_COLUMNS,
    OUSTER_ROWS,
    ouster_rays,
    scan,
)
from jradar.simulation.scenes.layouts import EYE_M, make_scene
from jradar.simulation.scenes.scene import Scene
from jradar.simulation.scenes.trajectory import STEP_S, mounted
from jradar.simulation.units import UnitSpec

EPOCH_S = 1_608_552_000.0  # 21 December 2020, when ColoRadar's first runs were made
LIVOX_POINT_BYTES = 19
GRAVITY = np.array([0.0, 0.0, 9.80665])
# White noise of the IMU in each record of force (m/s^2) and rate (rad/s). At 300 Hz it
# has a density of 177 ug/sqrt(Hz) and 0.010 deg/s/sqrt(Hz), as small MEMS IMUs have:
# the data sheet of Bosch's BMI160 says 180 ug and 0.007 deg/s. ColoRadar's 3DM-GX5-25
# is quieter, with 25 ug and 0.005 deg/s.
IMU_NOISE = (0.03, 3e-3)
# Standard deviation of its biases, 2 mg and 0.06 deg/s. They stay the same throughout a
# recording: their instability is left out.
IMU_BIAS = (0.02, 1e-3)


class Clock(NamedTuple):
    """Rate, start and jitter of a stream's stamps."""

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
SENSOR_CHOICES = {
    "single_chip": ("single_chip",),
    "cascade": ("cascade",),
    "both": ("single_chip", "cascade"),
}


class Setting(NamedTuple):
    """A scene and its radars: all that does not change during a recording."""

    scene: Scene
    reflectors: Reflectors
    seed: int
    radars: dict[str, tuple[RadarSpec, Hardware]]
    unit: UnitSpec


def make_setting(
    family: str, seed: int, *, sensor: str = "single_chip", unit: UnitSpec | None = None
) -> Setting:
    """Return the scene of a family and seed, and its radars.

    `sensor` is "single_chip", "cascade" or "both". A `unit` is a single chip; without
    one the rig is that of `jradar-sim-1`. Raises UsageError for another sensor.
    """
    if sensor not in SENSOR_CHOICES or (unit and sensor != "single_chip"):
        choices = ["single_chip"] if unit else SENSOR_CHOICES
        raise UsageError(f"sensor {sensor!r}, expected one of {', '.join(choices)}")
    scene = make_scene(family, seed)
    if unit is not None:
        return carried(scene, seed, unit)
    radars = {name: _radar(name) for name in SENSOR_CHOICES[sensor]}
    return Setting(scene, find_reflectors(scene.bodies), seed, radars, UnitSpec())


def carried(
    scene: Scene, seed: int, unit: UnitSpec, *, yaw_rad: float = 0.0
) -> Setting:
    """Return a scene in which the rig carries a unit, rotated aside by an angle."""
    radar = unit.radar()
    platform = mounted(
        scene.platform,
        raised_m=0.0 if unit.height_m is None else unit.height_m - EYE_M,
        tilt_rad=math.radians(unit.tilt_degrees),
        yaw_rad=yaw_rad,
        speed_mps=unit.speed_mps,
    )
    radars = {"single_chip": (radar, make_unit_hardware(unit, radar))}
    scene = scene._replace(platform=platform)
    return Setting(scene, find_reflectors(scene.bodies), seed, radars, unit)


def _radar(name):
    spec = RADARS[name]()
    return spec, make_hardware(name, spec)


def stream_stamps(
    setting: Setting, stream: str, seconds: float
) -> Float[np.ndarray, " item"]:
    """Return the times of a stream's items in a recording of `seconds`."""
    clock = CLOCKS[stream]
    count = max(round(seconds * clock.rate_hz), 1)
    if stream in ("groundtruth", "imu"):  # these begin before the others and end after
        count += round(0.4 * clock.rate_hz)
    random = np.random.default_rng([setting.seed, *stream.encode()])
    stamps = clock.start_s + np.arange(count) / clock.rate_hz
    return np.round(stamps + clock.jitter_s * random.standard_normal(count), 6)


def radar_frames(setting: Setting, sensor: str, stamps: np.ndarray) -> Iterator:
    """Yield a radar's frames [tx, rx, chirp, sample, 2] in int16."""
    for frame, time_s in enumerate(stamps):
        yield radar_frame(setting, sensor, float(time_s), frame)


def radar_frame(setting: Setting, sensor: str, time_s: float, frame: int) -> jax.Array:
    """Return the samples [tx, rx, chirp, sample, 2] of a time, in int16.

    The number of the `frame` determines its noise.
    """
    radar, hardware = setting.radars[sensor]
    scene, unit = setting.scene, setting.unit
    key = jax.random.fold_in(jax.random.key(setting.seed), len(sensor))
    paths = radar_paths(scene, setting.reflectors, sensor, time_s, radar, unit=unit)
    if counts := unit.clutter_counts:
        view = viewpoint(scene.platform, sensor, time_s)
        diffuse = diffuse_clutter(setting.seed, view, radar, counts=counts)
        paths = joined([paths, diffuse])
    return sample_frame(jax.random.fold_in(key, frame), paths, hardware, radar)


def lidar_scans(setting: Setting, stamps: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the Ouster's scans [65536, 4], float32."""
    directions, seconds = ouster_rays()
    for frame, time_s in enumerate(stamps):
        random = np.random.default_rng([setting.seed, 1, frame])
        yield scan(random, setting.scene, float(time_s), directions, seconds)


def simulate_sequence(
    family: str,
    seed: int,
    root: Path | str,
    *,
    frames: int = 50,
    sensor: str = "single_chip",
    unit: UnitSpec | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Write a sequence of a scene as `root/FAMILY_SEED`; return its folder.

    `sensor` and `unit` are as in `make_setting`; `frames` counts the frames of the
    first radar. The calibration of a unit lies in the sequence, together with
    `unit.json`; otherwise it is `root/calib`. `advance` is called after each frame.
    """
    if frames < 1:
        raise UsageError(f"frames = {frames}, expected 1 or more")
    setting = make_setting(family, seed, sensor=sensor, unit=unit)
    first = SENSOR_CHOICES[sensor][0]
    seconds = frames / CLOCKS[first].rate_hz
    folder = Path(root) / setting.scene.name
    if unit is None:
        both = {name: _radar(name) for name in RADARS}
        files.write_calib(Path(root) / "calib", both)
    with atomic_folder(folder, marker=files.NOTE) as scratch:
        files.write_note(scratch)
        if unit is not None:
            files.write_calib(scratch / "calib", setting.radars, unit)
            made = json.dumps(unit.written(), indent=1)
            (scratch / "unit.json").write_text(made + "\n")
        streams = [_radar_stream(setting, s, seconds, scratch) for s in setting.radars]
        streams.append(_lidar_stream(setting, seconds, scratch))
        _write_poses_and_imu(setting, seconds, scratch)
        while streams:  # in turn: JAX computes while rays are cast
            streams = [stream for stream in streams if next(stream, None)]
            if streams:
                advance()
    return folder


def frame_bytes(*, sensor: str = "single_chip", layout: str = "coloradar") -> float:
    """Return the bytes on disk of one radar frame and its share of the LiDAR scans.

    `layout` is "coloradar" or "capture". With both radars the frame is the first's.
    """
    first = CLOCKS[SENSOR_CHOICES[sensor][0]].rate_hz
    total = 0.0
    for name in SENSOR_CHOICES[sensor]:
        values = math.prod(RADARS[name]().cube_shape)
        total += 4 * values * CLOCKS[name].rate_hz / first
    scan_bytes = 16 * OUSTER_ROWS * OUSTER_COLUMNS
    if layout == "capture":
        scan_bytes = LIVOX_POINT_BYTES * MID360_POINTS
    return total + scan_bytes * CLOCKS["lidar"].rate_hz / first


def _radar_stream(setting, sensor, seconds, scratch):
    """Write a radar's frames, each while JAX computes the next."""
    stamps = stream_stamps(setting, sensor, seconds)
    folder = scratch / sensor / "adc_samples"
    files.write_stamps(folder, EPOCH_S + stamps)
    (folder / "data").mkdir()
    for k, frame in enumerate(radar_frames(setting, sensor, stamps)):
        yield True
        np.asarray(frame).astype("<i2").tofile(folder / "data" / f"frame_{k}.bin")


def _lidar_stream(setting, seconds, scratch):
    stamps = stream_stamps(setting, "lidar", seconds)
    files.write_stamps(scratch / "lidar", EPOCH_S + stamps)
    (scratch / "lidar" / "pointclouds").mkdir()
    for k, cloud in enumerate(lidar_scans(setting, stamps)):
        path = scratch / "lidar" / "pointclouds" / f"lidar_pointcloud_{k}.bin"
        cloud.astype("<f4").tofile(path)
        yield True


def _write_poses_and_imu(setting, seconds, scratch):
    """Write the true poses of the base, and the records of the IMU."""
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
    """Return specific force (m/s^2) and angular rate (rad/s) with the IMU's noise.

    The noise of each record is a density times the square root of the rate; the bias is
    drawn once for each recording.
    """
    platform, step = setting.scene.platform, 10 * STEP_S
    before, now, after = (
        sensor_pose(platform, "base", stamps + side) for side in (-step, 0.0, step)
    )
    force = (after[0] - 2 * now[0] + before[0]) / step**2 + GRAVITY
    change = Rotation.from_matrix(after[1] @ before[1].swapaxes(-1, -2))
    rate = change.as_rotvec() / (2 * step)
    to_imu = (now[1] @ base_from("imu")[:3, :3]).swapaxes(-1, -2)
    random = np.random.default_rng([setting.seed, 2])
    bias = random.normal(scale=np.repeat(IMU_BIAS, 3))
    noise = random.normal(scale=np.repeat(IMU_NOISE, 3), size=(len(stamps), 6))
    felt = [np.einsum("tij,tj->ti", to_imu, vector) for vector in (force, rate)]
    return np.concatenate(felt, -1) + bias + noise
