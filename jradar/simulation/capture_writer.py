"""A sequence written as a user's own capture: DCA1000 samples, a `.cfg`, a Livox bag.

FAMILY_SEED/adc_data.bin      int16, [frame][chirp][tx][rx], I0 I1 Q0 Q1
FAMILY_SEED/awr1843.cfg       configuration of the radar
FAMILY_SEED/lidar.bag         ROS 1: /livox/lidar (CustomMsg), /livox/imu
FAMILY_SEED/poses.txt         poses of the base in TUM's format: t x y z qx qy qz qw
FAMILY_SEED/capture.toml      description of the capture, which `jradar` reads
FAMILY_SEED/timestamps.txt    true start of each radar frame, seconds since 1970
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError, optional
from jradar.files import atomic_folder
from jradar.radar import RadarSpec
from jradar.simulation import coloradar_writer as files
from jradar.simulation.rig import EXTRINSICS, described_mount, sensor_pose
from jradar.simulation.scanner import MID360, MID360_LINES, mid360_rays, scan
from jradar.simulation.sequence import (
    EPOCH_S,
    Setting,
    imu_records,
    make_setting,
    radar_frames,
    stream_stamps,
)
from jradar.simulation.units import UnitSpec

FIRING_MASKS = (1, 4, 2)  # of the AWR1843's transmitters, in ColoRadar's order
FRAME_PERIOD_S = 0.1
CUSTOM_POINT = """\
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
CUSTOM_MSG = """\
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
livox_ros_driver2/CustomPoint[] points
"""
STANDARD_GRAVITY = 9.80665  # unit of Livox's IMU


def simulate_capture(
    family: str,
    seed: int,
    root: Path | str,
    *,
    frames: int = 50,
    period_s: float = FRAME_PERIOD_S,
    unit: UnitSpec | None = None,
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Write a capture of a scene as `root/FAMILY_SEED`; return its folder.

    Radar frames and LiDAR scans begin every `period_s`, a multiple of 0.1 s. A `unit`
    is described as its user measured it, without the factors of its channels. `advance`
    is called after each of the `frames` frames. Needs rosbags (the extra `ros`).
    """
    if frames < 1:
        raise UsageError(f"frames = {frames}, expected 1 or more")
    every = round(period_s / FRAME_PERIOD_S)
    if every < 1 or abs(every * FRAME_PERIOD_S - period_s) > 1e-6:
        raise UsageError(f"period_s = {period_s}, expected a multiple of 0.1 s")
    rosbag1, typesys = (
        optional(f"rosbags.{name}", need="bags need rosbags", extra="ros")
        for name in ("rosbag1", "typesys")
    )
    setting = make_setting(family, seed, sensor="single_chip", unit=unit)
    radar, _ = setting.radars["single_chip"]
    seconds = frames * every * FRAME_PERIOD_S
    stamps = stream_stamps(setting, "single_chip", seconds)[::every]
    folder = Path(root) / setting.scene.name
    with atomic_folder(folder, marker=files.NOTE) as scratch:
        files.write_note(scratch)
        write_cfg(scratch / "awr1843.cfg", radar, period_s=period_s)
        files.write_stamps(scratch, EPOCH_S + stamps)
        poses = stream_stamps(setting, "groundtruth", seconds)
        xyz, turn = sensor_pose(setting.scene.platform, "base", poses)
        turned = Rotation.from_matrix(turn).as_quat()
        rows = np.column_stack([EPOCH_S + poses, xyz, turned])
        np.savetxt(scratch / "poses.txt", rows, fmt="%.6f")
        mounts = EXTRINSICS
        if unit is not None:
            mounts = EXTRINSICS | {"single_chip": described_mount("single_chip", unit)}
        write_description(
            scratch / "capture.toml", mounts, start_time_s=EPOCH_S + stamps[0]
        )
        with open(scratch / "adc_data.bin", "wb") as samples:
            for frame in radar_frames(setting, "single_chip", stamps):
                samples.write(dca1000_bytes(np.asarray(frame)))
                advance()
        store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
        for name, text in (("CustomPoint", CUSTOM_POINT), ("CustomMsg", CUSTOM_MSG)):
            kind = f"livox_ros_driver2/msg/{name}"
            store.register(typesys.get_types_from_msg(text, kind))
        with rosbag1.Writer(scratch / "lidar.bag") as bag:
            _write_livox(bag, store, setting, seconds, every)
    return folder


def write_description(
    path: Path, mounts: Mapping[str, Any], *, start_time_s: float
) -> None:
    """Write the `capture.toml` of a simulated capture, with `EXTRINSICS` or others."""
    place = {
        sensor: f"xyz = {[*map(float, xyz)]}\nquaternion = {[*map(float, turn)]}\n"
        for sensor, (xyz, turn) in mounts.items()
    }
    path.write_text(
        '[radar]\nfile = "adc_data.bin"\ndescription = "awr1843.cfg"\n'
        f"start_time_s = {start_time_s:.6f}\n{place['single_chip']}\n"
        f'[lidar]\nfile = "lidar.bag"\ntopic = "/livox/lidar"\n{place["livox"]}\n'
        '[poses]\nfile = "poses.txt"\n\n'
        f'[imu]\nfile = "lidar.bag"\ntopic = "/livox/imu"\n{place["imu"]}',
        encoding="utf-8",
    )


def dca1000_bytes(frame: np.ndarray) -> bytes:
    """Return the bytes of a frame [tx, rx, chirp, sample, 2] as the card stores it."""
    tx, rx, chirps, samples, _ = frame.shape
    pairs = frame.transpose(2, 0, 1, 3, 4).reshape(chirps, tx, rx, samples // 2, 2, 2)
    return np.ascontiguousarray(pairs.swapaxes(-1, -2)).astype("<i2").tobytes()


def write_cfg(
    path: Path, radar: RadarSpec, *, period_s: float = FRAME_PERIOD_S
) -> None:
    """Write a `.cfg` of TI's mmWave SDK that configures an AWR1843 as `radar`."""
    profile = [
        *(0, radar.start_frequency_hz / 1e9, radar.idle_time_s * 1e6),
        *(radar.adc_start_time_s * 1e6, radar.ramp_end_time_s * 1e6, 0, 0),
        *(radar.slope_hz_per_s / 1e12, 0, radar.num_samples),
        *(radar.sample_rate_hz / 1e3, 0, 0, 30),
    ]
    masks, period_ms = FIRING_MASKS[: radar.num_tx], round(period_s * 1e3, 6)
    lines = [
        "% Written by jradar simulate: ColoRadar's single chip",
        "sensorStop",
        "flushCfg",
        "dfeDataOutputMode 1",
        f"channelCfg 15 {sum(masks)} 0",
        "adcCfg 2 1",
        "adcbufCfg -1 0 0 1 1",
        "profileCfg " + " ".join(f"{round(v, 9):.12g}" for v in profile),
        *(f"chirpCfg {k} {k} 0 0 0 0 0 {mask}" for k, mask in enumerate(masks)),
        f"frameCfg 0 {len(masks) - 1} {radar.num_chirps} 0 {period_ms:g} 1 0",
        "lvdsStreamCfg -1 0 1 0",
        "compRangeBiasAndRxChanPhase 0.0" + " 1 0" * 12,
        "sensorStart",
    ]
    path.write_text("\n".join(lines) + "\n")


def _write_livox(
    bag: Any, store: Any, setting: Setting, seconds: float, every: int
) -> None:
    """Write every so many LiDAR frames, and IMU records, of the Livox."""
    kind = "livox_ros_driver2/msg/CustomMsg"
    points = bag.add_connection("/livox/lidar", kind, typestore=store)
    times = stream_stamps(setting, "lidar", seconds)
    for frame, time_s in enumerate(times[::every]):
        message = _livox_message(store, setting, frame, float(time_s))
        bag.write(points, message.timebase, store.serialize_ros1(message, kind))
    kind = "sensor_msgs/msg/Imu"
    inertial = bag.add_connection("/livox/imu", kind, typestore=store)
    times = stream_stamps(setting, "imu", seconds)
    for time_s, record in zip(times, imu_records(setting, times), strict=True):
        stamp = round((EPOCH_S + time_s) * 1e6) * 1000
        message = _imu_message(store, stamp, record)
        bag.write(inertial, stamp, store.serialize_ros1(message, kind))


def _livox_message(store: Any, setting: Setting, frame: int, time_s: float) -> Any:
    """Return a CustomMsg of one scan, in which lost returns are (0, 0, 0)."""
    directions, seconds = mid360_rays(frame)
    random = np.random.default_rng([setting.seed, 3, frame])
    cloud = scan(random, setting.scene, time_s, directions, seconds, scanner=MID360)
    types = store.types
    stamp = round((EPOCH_S + time_s) * 1e6) * 1000
    offsets = np.rint(seconds * 1e9).astype(int).tolist()
    brightness = np.clip(cloud[:, 3], 0, 255).astype(int).tolist()
    point = types["livox_ros_driver2/msg/CustomPoint"]
    points = [
        point(offset, x, y, z, bright, 0, k % MID360_LINES)
        for k, (offset, (x, y, z), bright) in enumerate(
            zip(offsets, cloud[:, :3].tolist(), brightness, strict=True)
        )
    ]
    return types["livox_ros_driver2/msg/CustomMsg"](
        header=_header(types, stamp),
        timebase=stamp,
        point_num=len(points),
        lidar_id=0,
        rsvd=np.zeros(3, np.uint8),
        points=points,
    )


def _imu_message(store: Any, stamp: int, record: np.ndarray) -> Any:
    """Return an Imu message with forces in units of gravity."""
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    unknown = np.zeros(9)
    return types["sensor_msgs/msg/Imu"](
        header=_header(types, stamp),
        orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=unknown,
        angular_velocity=vector(*record[3:].tolist()),
        angular_velocity_covariance=unknown,
        linear_acceleration=vector(*(record[:3] / STANDARD_GRAVITY).tolist()),
        linear_acceleration_covariance=unknown,
    )


def _header(types, stamp_ns):
    time = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
    return types["std_msgs/msg/Header"](seq=0, stamp=time, frame_id="livox_frame")
