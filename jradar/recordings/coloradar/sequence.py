"""ColoRadar (Kramer et al. 2022): sequences of radar, LiDAR and true poses.

    <root>/calib/transforms/base_to_<sensor>.txt     calib/ may also lie in a sequence,
    <root>/calib/<radar>/waveform_cfg.txt ..         next to it, or up to three above
    <root>/<sequence>/<radar>/adc_samples/    timestamps.txt  data/frame_<N>.bin
                     /lidar/                  timestamps.txt  pointclouds/lidar_pointcloud_<N>.bin
                     /groundtruth/            timestamps.txt  groundtruth_poses.txt
                     /imu/                    timestamps.txt  imu_data.txt

A line of imu_data.txt is ax ay az gx gy gz, in m/s^2 and rad/s.

<radar> is single_chip (AWR1843) or cascade. Each stream has its own rate and its own
stamps, in seconds since 1970. Opening a sequence lists folders and reads calibration,
stamps and poses; frames are read when accessed. Clouds are x forward, y left, z up, in
their sensor's frame.
"""  # noqa: E501

import dataclasses
import os
from pathlib import Path

import numpy as np

import jradar
from jradar.errors import UsageError, parsing
from jradar.lidar import Poses
from jradar.options.recordings import SENSORS
from jradar.options.sensor import RadarSpec
from jradar.recordings.clouds.read import read_bin
from jradar.recordings.coloradar.calib import (
    radar_from_coloradar,
    read_coupling,
    read_frequency_phase,
)
from jradar.recordings.coloradar.files import (
    file_stream,
    read_cube,
    read_stamped,
    read_transform,
)
from jradar.recordings.radar_toml import read_radar_toml
from jradar.recordings.recording import Format, Imu, Recording
from jradar.recordings.ti.frame import CaptureSpec

KINDS = ("adc_samples", "heatmaps", "pointclouds")  # folders of a radar in the release
LEVELS_UP = 3  # above a sequence, where calib/ is looked for


def open_coloradar(
    folder: Path | str,
    description: Path | str | None = None,
    *,
    sensor: str | None = None,
) -> Recording:
    """Open a sequence with one radar, LiDAR, IMU, poses, transforms, calibration.

    `description` is the `calib` folder, by default the one inside, next to or above the
    sequence; or a TOML file with the radar and its channels' factors, which replaces
    the radar of that folder. `sensor` is by default the single chip if it was recorded.
    Raises UsageError if the radar's samples or its calibration are not found, and
    ValueError for damaged files.
    """
    folder = Path(folder)
    notes: list[str] = []
    sensor = _sensor(folder, sensor, notes)
    calib = Path(description or _find_calib(folder, sensor))
    if calib.suffix == ".toml":
        radar, capture = read_radar_toml(calib)
        calib = _find_calib(folder, sensor)
    else:
        radar = radar_from_coloradar(calib / sensor)
        capture = CaptureSpec()
    at = folder / sensor / "adc_samples"
    cubes = file_stream(
        at / "data", "frame", at / "timestamps.txt", lambda file: read_cube(file, radar)
    )
    notes += cubes.notes
    lidar = poses = None
    at = folder / "lidar"
    if (at / "pointclouds").is_dir():
        # A missing return of the Ouster is (0, 0, 0); a scan may be empty.
        lidar = file_stream(
            at / "pointclouds", "lidar_pointcloud", at / "timestamps.txt", read_bin
        )
        notes += lidar.notes
    if (folder / "groundtruth" / "groundtruth_poses.txt").is_file():
        poses = _poses(folder / "groundtruth", notes)
    imu = base_from_imu = None
    if (folder / "imu" / "imu_data.txt").is_file():
        times, rows = read_stamped(folder / "imu", "imu_data.txt", 6, notes)
        imu = Imu(times, force=rows[:, :3], rate=rows[:, 3:])
        base_from_imu = _base_from(calib, ("imu",), notes)
    return Recording(
        name=folder.absolute().name,
        path=folder,
        radar=_calibrated(radar, capture, calib / sensor),
        cubes=cubes,
        lidar=lidar,
        poses=poses,
        imu=imu,
        base_from_imu=base_from_imu,
        # ColoRadar+ calls its only radar `radar`.
        base_from_radar=_base_from(calib, (sensor, "radar"), notes),
        base_from_lidar=_base_from(calib, ("lidar",), notes),
        notes=(f"calibration: {calib}", *notes),
    )


READER = Format(
    "a ColoRadar sequence, a folder with single_chip/adc_samples or "
    "cascade/adc_samples",
    lambda path: any((path / s / kind).is_dir() for s in SENSORS for kind in KINDS),
    open_coloradar,
    ("description", "sensor"),
)


def _find_calib(folder: Path, sensor: str) -> Path:
    """Return the `calib` folder in, next to or above a sequence or a link's target."""
    starts = dict.fromkeys([os.path.abspath(folder), os.path.realpath(folder)])
    levels = [[Path(s), *Path(s).parents][: LEVELS_UP + 1] for s in starts]
    places = list(dict.fromkeys(place / "calib" for way in levels for place in way))
    for place in places:
        if (place / sensor / "waveform_cfg.txt").is_file():
            return place
    raise UsageError(
        f"no calib/{sensor}/waveform_cfg.txt for {folder}, looked in "
        f"{', '.join(map(str, places))}: ColoRadar offers calib/ as a separate "
        "download; unpack it next to the sequences, or name it with --radar"
    )


def _sensor(folder: Path, sensor: str | None, notes: list[str]) -> str:
    """Return the radar to read, one whose raw samples exist."""
    if sensor is not None and sensor not in SENSORS:
        raise UsageError(f"sensor = {sensor!r}, expected {' or '.join(SENSORS)}")
    here = [s for s in SENSORS if (folder / s / "adc_samples" / "data").is_dir()]
    if sensor in here:
        return sensor
    if sensor is not None or not here:
        wanted = f"{sensor or '<radar>'}/adc_samples/data"
        other = f", but {here[0]}/adc_samples/data" if here else ""
        raise UsageError(
            f"{folder} holds no {wanted}{other}: ColoRadar offers raw samples as a "
            "separate download"
        )
    if len(here) > 1:
        notes.append(f"radar: {here[0]}; {here[1]} was recorded as well")
    return here[0]


def _calibrated(spec: RadarSpec, capture: CaptureSpec, folder: Path) -> "jradar.Radar":
    """Return the radar with the calibration of its folder, then that of a TOML file."""
    radar = jradar.Radar(spec, range_bias_m=capture.range_bias_m)
    if (path := folder / "coupling_calib.txt").is_file():
        with parsing(path, "the leakage of this radar"):
            radar = dataclasses.replace(radar, leakage=read_coupling(path))
    if (path := folder / "phase_frequency_calib.txt").is_file():
        with parsing(path, "a calibration of this radar"):
            channels, bins = read_frequency_phase(path, spec)
            radar = dataclasses.replace(radar, channels=channels, beat_bins=bins)
    factors = capture.radar(spec).channels
    return radar if factors is None else radar.with_factors(factors.ravel())


def _base_from(calib, names, notes):
    """Return the transform to the base of the first of `names`; None without one."""
    for name in names:
        if (path := calib / "transforms" / f"base_to_{name}.txt").is_file():
            return read_transform(path)
    notes.append(f"no {calib / 'transforms' / f'base_to_{names[0]}.txt'}")
    return None


def _poses(folder: Path, notes: list[str]) -> Poses:
    """Return the poses of a sequence; ValueError if one is not a rotation."""
    name = "groundtruth_poses.txt"
    times, rows = read_stamped(folder, name, 7, notes)
    length = np.linalg.norm(rows[:, 3:], axis=1)
    if len(bad := np.flatnonzero(abs(length - 1) > 0.01)):
        raise ValueError(
            f"{folder / name}: the quaternion at {times[bad[0]]:.6f} s has length "
            f"{length[bad[0]]:.4g}, expected 1: is the order x y z qx qy qz qw?"
        )
    return Poses(times, rows[:, :3], rows[:, 3:] / length[:, None])
