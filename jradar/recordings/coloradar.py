"""ColoRadar (Kramer et al. 2022): sequences of radar, LiDAR, IMU and true poses.

    <root>/calib/transforms/base_to_<sensor>.txt     calib/ may also lie in a sequence,
    <root>/calib/<radar>/waveform_cfg.txt ..         beside it, or up to three above
    <root>/<sequence>/<radar>/adc_samples/    timestamps.txt  data/frame_<N>.bin
                     /<radar>/heatmaps/       timestamps.txt  data/heatmap_<N>.bin
                     /<radar>/pointclouds/    timestamps.txt  data/radar_pointcloud_<N>.bin
                     /lidar/                  timestamps.txt  pointclouds/lidar_pointcloud_<N>.bin
                     /imu/  groundtruth/  vicon/

<radar> is single_chip (AWR1843) or cascade. `open_coloradar` is the way in; the other
functions read what lies beside. Streams run at rates of their own and are paired by
their stamps, in seconds since 1970. Opening lists folders and reads calibration, stamps
and poses, never a frame. Clouds are x forward, y left, z up, in their sensor's frame.
"""  # noqa: E501

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.lidar import Poses
from jradar.radar import RadarSpec
from jradar.recordings.coloradar_calib import (
    radar_from_coloradar,
    read_coupling,
    read_frequency_phase,
)
from jradar.recordings.coloradar_files import (
    file_stream,
    read_records,
    read_samples,
    read_stamps,
    read_table,
    read_transform,
)
from jradar.recordings.recording import Recording, Stream

SENSORS = ("single_chip", "cascade")
LEVELS_UP = 3  # where calib/ is looked for
HEATMAP_SHAPES = {"single_chip": (16, 64, 64), "cascade": (32, 128, 128)}


class Imu(NamedTuple):
    """An inertial measurement unit's samples, in its own frame."""

    stamps: Float[np.ndarray, " item"]  # seconds
    acceleration: Float[np.ndarray, "item 3"]  # m/s^2
    angular_velocity: Float[np.ndarray, "item 3"]  # rad/s


def open_coloradar(
    folder: Path | str,
    *,
    sensor: str | None = None,
    tx_firing_order: tuple[int, ...] | None = None,
    calib: Path | str | None = None,
) -> Recording:
    """A sequence with its radar `sensor`, LiDAR, poses, transforms and calibration.

    Without `sensor` the single chip is taken where there are both. The order in which
    the cascade fires is not in the files: TI's default unless `tx_firing_order` is
    given. `calib` is looked for inside, beside and above the sequence. Raises
    ValueError for what is not a sequence, or lacks its radar's calibration.
    """
    folder = Path(folder)
    notes: list[str] = []
    sensor = _sensor(folder, sensor, notes)
    calib = find_calib(folder, sensor) if calib is None else Path(calib)
    radar = radar_from_coloradar(calib / sensor, tx_firing_order=tx_firing_order)
    cubes = _adc_samples(folder, sensor, radar)
    notes += cubes.notes
    lidar = poses = None
    if (folder / "lidar" / "pointclouds").is_dir():
        lidar = coloradar_lidar(folder)
        notes += lidar.notes
    if (folder / "groundtruth" / "groundtruth_poses.txt").is_file():
        poses = _poses(folder, "groundtruth", notes)
    coupling = frequency_phase = None
    if (path := calib / sensor / "coupling_calib.txt").is_file():
        coupling = read_coupling(path)
        _check_array(path, coupling.shape, radar, (radar.num_samples // 2,))
    if (path := calib / sensor / "phase_frequency_calib.txt").is_file():
        frequency_phase = read_frequency_phase(path)
        _check_array(path, frequency_phase.phase.shape, radar, ())
    return Recording(
        name=folder.absolute().name,
        path=folder,
        radar=radar,
        cubes=cubes,
        lidar=lidar,
        poses=poses,
        base_from_radar=_base_from(calib, (sensor, "radar"), notes),
        base_from_lidar=_base_from(calib, ("lidar",), notes),
        coupling=coupling,
        frequency_phase=frequency_phase,
        notes=(f"calibration: {calib}", *notes),
    )


def is_coloradar(folder: Path | str) -> bool:
    """Whether a folder looks like a sequence: a radar's folder with one of its kinds
    of data.
    """
    kinds = ("adc_samples", "heatmaps", "pointclouds")
    return any((Path(folder) / s / kind).is_dir() for s in SENSORS for kind in kinds)


def find_calib(folder: Path | str, sensor: str) -> Path:
    """The `calib` folder of a sequence: inside, beside, or up to three levels above it.

    Where the sequence is a link, its target's surroundings are searched as well.
    Raises ValueError, naming the places, where there is none for this radar.
    """
    starts = dict.fromkeys([os.path.abspath(folder), os.path.realpath(folder)])
    levels = [[Path(s), *Path(s).parents][: LEVELS_UP + 1] for s in starts]
    places = list(dict.fromkeys(place / "calib" for way in levels for place in way))
    for place in places:
        if (place / sensor / "waveform_cfg.txt").is_file():
            return place
    raise ValueError(
        f"no calib/{sensor}/waveform_cfg.txt for {folder}, looked in "
        f"{', '.join(map(str, places))}: ColoRadar ships calib/ apart from the "
        "sequences; unpack it beside them, or name it"
    )


def coloradar_lidar(folder: Path | str) -> Stream:
    """LiDAR scans of a sequence, float32 [point, 4]: x y z intensity.

    The Ouster writes a missing return as (0, 0, 0); a scan may be empty.
    """
    lidar = Path(folder) / "lidar"
    return file_stream(
        lidar / "pointclouds",
        "lidar_pointcloud",
        lidar / "timestamps.txt",
        lambda path: read_records(path, 4),
    )


def coloradar_clouds(folder: Path | str, *, sensor: str = "single_chip") -> Stream:
    """The radar's own clouds, float32 [point, 5]: x y z intensity, velocity in m/s.

    The release has them for the single chip only.
    """
    return _radar_stream(
        folder,
        sensor,
        "pointclouds",
        "radar_pointcloud",
        lambda path: read_records(path, 5),
    )


def coloradar_heatmaps(
    folder: Path | str, *, sensor: str, calib: Path | str | None = None
) -> Stream:
    """The release's heatmaps, float32 [elevation, azimuth, range, 2].

    The pair is the peak over velocity and its velocity; range index k is range bin
    k + 1. Velocities of the cascade are far too small in the release: recompute them.
    The size is that of `calib/<sensor>/heatmap_cfg.txt` where `calib` is given, the
    release's otherwise.
    """
    shape = HEATMAP_SHAPES[_known(sensor)]
    if calib is not None:
        shape = _heatmap_shape(Path(calib) / sensor / "heatmap_cfg.txt")
    axes = dict(zip(("elevation", "azimuth", "range"), shape, strict=True))
    return _radar_stream(
        folder,
        sensor,
        "heatmaps",
        "heatmap",
        lambda path: (
            read_samples(path, "<f4", axes | {"halves": 2})
            .reshape(*shape, 2)
            .astype(np.float32, copy=False)
        ),
    )


def coloradar_imu(folder: Path | str) -> Imu:
    """The sequence's IMU; warns where stamps and samples differ in number."""
    notes: list[str] = []
    stamps, rows = _stamped(Path(folder) / "imu", "imu_data.txt", 6, notes)
    _warn(notes)
    return Imu(stamps, rows[:, :3], rows[:, 3:])


def coloradar_poses(folder: Path | str, *, source: str = "groundtruth") -> Poses:
    """Poses of the base in the world; `source` is "groundtruth" or "vicon".

    At rising times; warns where the file's had to be sorted or thinned.
    """
    if source not in ("groundtruth", "vicon"):
        raise ValueError(f"{source=}, expected 'groundtruth' or 'vicon'")
    notes: list[str] = []
    poses = _poses(Path(folder), source, notes)
    _warn(notes)
    return poses


def _adc_samples(folder: Path, sensor: str, radar: RadarSpec) -> Stream:
    """ADC frames, int16 [tx][rx][chirp][sample][I, Q], as complex64."""
    axes = dict(
        zip(("tx", "rx", "chirps", "samples"), radar.cube_shape, strict=True), halves=2
    )

    def read(path: Path) -> np.ndarray:
        halves = read_samples(path, "<i2", axes).astype(np.float32)
        return halves.view(np.complex64).reshape(radar.cube_shape)

    return _radar_stream(folder, sensor, "adc_samples", "frame", read)


def _radar_stream(folder: Path | str, sensor: str, kind: str, prefix: str, read):
    """Numbered files of one radar."""
    at = Path(folder) / _known(sensor) / kind
    return file_stream(at / "data", prefix, at / "timestamps.txt", read)


def _sensor(folder: Path, sensor: str | None, notes: list[str]) -> str:
    """The radar to read, one whose raw samples are there."""
    here = [s for s in SENSORS if (folder / s / "adc_samples" / "data").is_dir()]
    if sensor is None and here:
        if len(here) > 1:
            notes.append(f"radar: {here[0]}; {here[1]} was recorded as well")
        return here[0]
    if sensor is None or _known(sensor) not in here:
        wanted = f"{sensor}/adc_samples/data" if sensor else "<radar>/adc_samples/data"
        there = f", it has those of {here[0]}" if here else ""
        raise ValueError(
            f"{folder} has no {wanted}{there}: ColoRadar's raw samples are a download "
            "of their own"
        )
    return sensor


def _known(sensor: str) -> str:
    """The name of a radar, checked."""
    if sensor not in SENSORS:
        raise ValueError(f"{sensor=}, expected one of {[*SENSORS]}")
    return sensor


def _check_array(
    path: Path, shape: Sequence[int], radar: RadarSpec, more: tuple[int, ...]
) -> None:
    """Refuse a calibration that is another radar's."""
    expected = (radar.num_tx, radar.num_rx, *more)
    if tuple(shape) != expected:
        raise ValueError(
            f"{path} is for an array of {tuple(shape)}, {radar.name} needs {expected} "
            "[tx, rx, range bins]"
        )


def _base_from(calib: Path, names: Sequence[str], notes: list[str]):
    """Transform from a sensor to the base; ColoRadar+ has its only radar as `radar`."""
    for name in names:
        if (path := calib / "transforms" / f"base_to_{name}.txt").is_file():
            return read_transform(path)
    notes.append(f"no {calib / 'transforms' / f'base_to_{names[0]}.txt'}")
    return None


def _heatmap_shape(path: Path) -> tuple[int, ...]:
    """Bins of elevation, azimuth and range in a heatmap's description."""
    if path.stat().st_size > 1 << 20:
        raise ValueError(f"{path} is no description of a heatmap: too large")
    lines = path.read_text("utf-8", errors="replace").splitlines()
    values = {line.split()[0]: line.split()[1:] for line in lines if line.strip()}
    keys = [f"num_{axis}_bins" for axis in ("elevation", "azimuth", "range")]
    shape = [values.get(key, [""])[0] for key in keys]
    if not all(text.isdecimal() and 0 < int(text) < 2**16 for text in shape):
        raise ValueError(f"{path}: expected lines {', '.join(keys)}, got {shape}")
    return tuple(map(int, shape))


def _stamped(folder: Path, name: str, columns: int, notes: list[str]):
    """Stamps of a folder, and the rows of its table, as many of each."""
    stamps = read_stamps(folder / "timestamps.txt", notes)
    rows = read_table(folder / name, columns)
    if len(stamps) != len(rows):
        notes.append(
            f"{folder.name}: {len(stamps)} stamps for {len(rows)} lines of {name}: the "
            "rest at the end is left out"
        )
    count = min(len(stamps), len(rows))
    return stamps[:count], rows[:count]


def _poses(folder: Path, source: str, notes: list[str]) -> Poses:
    """Poses at rising times; of poses with one stamp the first is kept."""
    stamps, rows = _stamped(folder / source, f"{source}_poses.txt", 7, notes)
    length = np.linalg.norm(rows[:, 3:], axis=1)
    if len(bad := np.flatnonzero(abs(length - 1) > 0.01)):
        raise ValueError(
            f"{folder / source}: line {bad[0] + 1} of {source}_poses.txt has a "
            f"quaternion of length {length[bad[0]]:.4g}, expected 1: x y z qx qy qz qw?"
        )
    times, order = np.unique(stamps, return_index=True)
    return Poses(times, rows[order, :3], rows[order, 3:] / length[order, None])


def _warn(notes: list[str]) -> None:
    """Say what was mended to a caller who gets no `Recording`."""
    for note in notes:
        warnings.warn(note, stacklevel=3)
