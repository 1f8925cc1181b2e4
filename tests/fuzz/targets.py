"""The readers, each with a small valid file to damage."""

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
import safetensors.numpy

from jradar.data import PrepareSpec, Records, find_sources
from jradar.data.records import from_bytes, to_bytes
from jradar.diffusion.weights.files import read_state
from jradar.evaluation import read_scores, write_scores
from jradar.evaluation.report import load_clouds, save_clouds
from jradar.model import load_model, save_model
from jradar.outputs.guard import GuardedFolder
from jradar.recordings import describe, open_recording
from jradar.recordings.bags.bags import bag_topics, open_bag, open_imu
from jradar.recordings.clouds.read import read_cloud
from jradar.recordings.descriptions import read_description
from jradar.recordings.text_files import read_tum
from jradar.viz import learning_curve_figure
from tests.data.prepared import invented_frame
from tests.data.test_records import write_folder
from tests.evaluation.invented import scores
from tests.models import tiny_model
from tests.recordings import bag_writer as bags, cube_writer, lua_writer, small_sequence
from tests.recordings.bags import test_imu as imu_bags, test_raw as raw_bags
from tests.recordings.clouds.test_read import pcd, ply
from tests.recordings.coloradar_writer import coupling_text, phases_text
from tests.recordings.dca1000_writer import (
    CFG,
    as_bytes,
    as_packets,
    random_cubes,
    with_headers,
)
from tests.recordings.points import ti_writer
from tests.recordings.test_descriptions import STUDIO
from tests.recordings.ti import test_packet_trace as traces
from tests.recordings.ti.test_studio_log import SECOND

CAPTURE = """\
[radar]
file = "adc_data.bin"
description = "adc_LogFile.txt"
start_time_s = 10.5
frame_period_s = 0.1
xyz = [0.1, 0.2, 0.3]
rpy_degrees = [0, 0, 90]
iq_order = "IIQQ"
[poses]
file = "poses.txt"
"""
POSES = "".join(f"{t} {t} 0 0 0 0 0 1\n" for t in range(20))
SPEC = "block = 4\n[points]\ncapacity = 64\nguard = [1, 2]\n[lidar]\nmax_range_m = 7.0"


METRICS = "".join(f'{{"step": {n}, "loss": {1 / (n + 1)}}}\n' for n in range(5))


class Target(NamedTuple):
    """A file to damage, its reader, and the length of its binary header."""

    path: Path
    read: Callable[[], Any]
    head: int = 0


def target(write: Callable[[Path], Path], read: Callable, *parts: str, head: int = 0):
    """Return a maker of a target: `write` fills a folder and returns what `read` takes.

    The file to damage is at `parts` in the folder, or that path, or a bag's file there.
    """

    def make(folder: Path) -> Target:
        path = write(folder)
        damaged = folder.joinpath(*parts) if parts else bags.files_of(path)[0]
        return Target(damaged, lambda: read(path), head)

    return make


def text(name: str, content: str | bytes, read: Callable, head: int = 0):
    """Return a maker of a target that is one file."""

    def write(folder: Path) -> Path:
        raw = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(raw)
        return folder / name

    return target(write, read, head=head)


# What reads


def described(path: Path) -> None:
    """Open a recording, describe it, and read its first and last frame."""
    recording = open_recording(path)
    describe(recording)
    for index in (0, -1):
        assert recording.cubes[index].ndim == 4


def read_points(path: Path) -> None:
    """Open a radar's points, describe them, and read every frame."""
    recording = open_recording(path)
    describe(recording)
    for cloud in recording.points or ():
        assert cloud.xyz.shape == (len(cloud.valid), 3)


def read_bag(path: Path) -> None:
    for topic in bag_topics(path):
        for cloud in open_bag(path, topic=topic):
            assert cloud.shape[1] == 4


def read_records(folder: Path) -> None:
    found = Records(folder)
    assert found[len(found) - 1].radar.xyz.ndim == 2
    found.verify()


def read_record(path: Path) -> None:
    """Read a record of one frame, below the checks of its shard."""
    try:
        from_bytes(path.read_bytes())
    except ValueError as error:  # `Records` adds the name of the shard
        raise ValueError(f"{path}: {error}") from error


# What writes


def studio(folder: Path) -> Path:
    samples = cube_writer.random_cube((3, *cube_writer.SHAPE))
    return cube_writer.save_studio(folder, samples)


def capture(folder: Path) -> Path:
    studio(folder)
    (folder / "poses.txt").write_text(POSES)
    (folder / "capture.toml").write_text(CAPTURE)
    return folder


def packets(folder: Path) -> Path:
    (folder / "radar.cfg").write_text(CFG)
    path = folder / "adc_data_Raw_0.bin"
    path.write_bytes(with_headers(as_packets(as_bytes(random_cubes()))))
    return path


def trace(folder: Path, name: str = "trace.pcap") -> Path:
    return traces.trace(folder, map(traces.datagram, traces.packets()), name)


def cube(folder: Path, pairs: bool = False) -> Path:
    array = cube_writer.random_cube()
    if pairs:
        array = np.stack([array.real, array.imag], -1).astype(np.int16)
    return cube_writer.save(folder, array, ["tx", "rx", "chirp", "sample"])


def sequence(folder: Path) -> Path:
    path = small_sequence.write_sequence(folder, frames=2)
    calib, channels = folder / "calib" / "single_chip", np.ones((3, 4))
    coupling = coupling_text(np.full((3, 4, 32), 1.5 + 1.5j))
    (calib / "coupling_calib.txt").write_text(coupling)
    phases = phases_text(channels, channels * (1 + 0.5j))
    (calib / "phase_frequency_calib.txt").write_text(phases)
    small_sequence.write_stamps(path / "imu", np.arange(4.0))
    (path / "imu" / "imu_data.txt").write_text("0 0.5 9.8 0 0 1e-3\n" * 4)
    return path


def results(folder: Path) -> Path:
    GuardedFolder(folder, "points").put({"a.csv": lambda path: path.write_bytes(b"1")})
    return folder


def splits(folder: Path) -> Path:
    (folder / "run0" / "single_chip" / "adc_samples" / "data").mkdir(parents=True)
    small_sequence.write_splits(folder, {"run0": "train"})
    return folder


def clouds_bag(folder: Path, container: str, compressed: str) -> Path:
    """A bag with clouds of two kinds."""
    rows = bags.livox_rows(20)
    stamps = range(bags.START, bags.START + 3)
    messages = [("/l", bags.LIVOX, stamp, bags.livox(rows, stamp)) for stamp in stamps]
    made = bags.point_cloud2(bags.columns(20), bags.START)
    messages.append(("/p", bags.CLOUD, bags.START, made))
    return bags.write_bag(folder / "bag", container, messages, compressed)


def points_bag(folder: Path) -> Path:
    """A bag of a radar's points, written without the tests' fields of a LiDAR."""
    names = [(name, 7, "f") for name in ("x", "y", "z", "doppler", "snr")]
    table = dict(zip("xyz", POINTS.T, strict=False))
    table |= {"doppler": POINTS[:, 3], "snr": POINTS[:, 3]}
    with mock.patch.object(bags, "FIELDS", names):
        make = bags.point_cloud2(table, bags.START)
        messages = [("/r", bags.CLOUD, bags.START, make)]
        return bags.write_bag(folder / "bag", "mcap", messages)


def points_npz(folder: Path) -> Path:
    np.savez(folder / "a.npz", xyz=POINTS[:, :3], velocity=POINTS[:, 3])
    return folder / "a.npz"


def model(folder: Path) -> Path:
    save_model(folder / "model", tiny_model())
    return folder / "model"


def npz_weights(folder: Path) -> Path:
    np.savez(folder / "a.npz", **{"a.weight": np.ones((4, 3), np.float32)})
    return folder / "a.npz"


def clouds(folder: Path) -> Path:
    """Clouds of an evaluation."""
    named = {"jradar": np.ones((4, 4)), "LiDAR": np.ones((5, 3))}
    save_clouds(folder / "clouds.npz", {("Hallways", "run0", 3): named})
    return folder / "clouds.npz"


def score_file(folder: Path) -> Path:
    write_scores(folder / "scores.jsonl", scores(frames=3))
    return folder / "scores.jsonl"


def coloradar(*parts: str):
    """Return a maker of a file of a ColoRadar sequence; the rest stays whole."""
    return target(sequence, described, *parts)


def bag(container: str, compressed: str = "", *parts: str):
    """Return a maker of a bag, or of a file beside its messages."""
    write = functools.partial(clouds_bag, container=container, compressed=compressed)
    return target(write, read_bag, *parts)


POINTS = np.random.default_rng(0).uniform(1, 9, (20, 4)).astype("<f4")
RANGES = np.linalg.norm(POINTS[:, :3], axis=1)
TJ4D = np.column_stack([POINTS, RANGES, *np.ones((3, 20), "<f4")]).astype("<f4")
SERIAL = [ti_writer.packet(k, POINTS.tolist(), [9.0] * 20) for k in range(4)]
CHIP = ("calib", "single_chip")
RUN = ("run0", "single_chip", "adc_samples")
WEIGHTS = safetensors.numpy.save({"a.weight": np.ones((4, 3), np.float32)})
TARGETS: dict[str, Callable[[Path], Target]] = {
    "radar.toml": text("radar.toml", cube_writer.RADAR, read_description),
    "radar.cfg": text("radar.cfg", CFG, read_description),
    "studio log": text("LogFile.txt", cube_writer.LOG + SECOND, read_description),
    "studio lua": text("a.lua", lua_writer.script(), read_description),
    "mmwave.json": text("a.mmwave.json", json.dumps(STUDIO), read_description),
    "capture.toml": target(capture, described, "capture.toml"),
    "samples": target(studio, described),
    "packets": target(packets, described, head=14),
    "trace": target(trace, described, head=40),
    "trace ng": target(
        functools.partial(trace, name="trace.pcapng"), described, head=40
    ),
    "raw bag": target(raw_bags.write, described),
    "cube": target(cube, described, head=128),
    "cube of pairs": target(functools.partial(cube, pairs=True), described, head=128),
    "cube's toml": target(cube, described, "radar.toml"),
    "poses": text("poses.txt", POSES, read_tum),
    "waveform": coloradar(*CHIP, "waveform_cfg.txt"),
    "antennas": coloradar(*CHIP, "antenna_cfg.txt"),
    "coupling": coloradar(*CHIP, "coupling_calib.txt"),
    "phases": coloradar(*CHIP, "phase_frequency_calib.txt"),
    "transform": coloradar("calib", "transforms", "base_to_lidar.txt"),
    "stamps": coloradar(*RUN, "timestamps.txt"),
    "frame": coloradar(*RUN, "data", "frame_0.bin"),
    "scan": coloradar("run0", "lidar", "pointclouds", "lidar_pointcloud_0.bin"),
    "true poses": coloradar("run0", "groundtruth", "groundtruth_poses.txt"),
    "imu": coloradar("run0", "imu", "imu_data.txt"),
    "imu bag": target(imu_bags.write, open_imu),
    "results": target(results, lambda path: GuardedFolder(path, "points"), ".jradar"),
    "metrics": text("metrics.jsonl", METRICS, learning_curve_figure),
    "splits": target(splits, find_sources, "splits.json"),
    "pcd ascii": text("a.pcd", pcd("ascii"), read_cloud),
    "pcd binary": text("a.pcd", pcd("binary"), read_cloud),
    "pcd packed": text("a.pcd", pcd("binary_compressed"), read_cloud),
    "ply ascii": text("a.ply", ply("ascii"), read_cloud),
    "ply binary": text("a.ply", ply("binary_little_endian"), read_cloud),
    "kitti": text("a.bin", np.ones((20, 4), "<f4").tobytes(), read_cloud),
    "bag": bag("bag"),
    "bag bz2": bag("bag", "bz2"),
    "bag lz4": bag("bag", "lz4"),
    "sqlite": bag("sqlite"),
    "bag's metadata": bag("sqlite", "", "bag", "sqlite", "metadata.yaml"),
    "sqlite zstd": bag("sqlite", "message"),
    "mcap": bag("mcap"),
    "mcap zstd": bag("mcap", "storage"),
    "serial stream": text("a.dat", b"".join(SERIAL), read_points, head=80),
    "bytes in a csv": text(
        "a.csv",
        "\n".join(f'{k},"{",".join(map(str, one))}"' for k, one in enumerate(SERIAL)),
        read_points,
    ),
    "points csv": text(
        "b.csv",
        "x,y,z,doppler\n" + "\n".join(",".join(map(str, p)) for p in POINTS.tolist()),
        read_points,
    ),
    "points npz": target(points_npz, read_points, head=200),
    "points bin": text("a.bin", TJ4D.tobytes(), read_points),
    "points bag": target(points_bag, read_points),
    "manifest": target(write_folder, read_records, "manifest.json"),
    "shard": target(write_folder, read_records, "run0", "0000.array_record"),
    "record": text(
        "frame.safetensors", to_bytes(invented_frame(0)), read_record, head=600
    ),
    "prepare's toml": text("spec.toml", SPEC, PrepareSpec.from_toml),
    "model.json": target(model, load_model, "model", "model.json"),
    "model's weights": target(
        model, load_model, "model", "weights.safetensors", head=200
    ),
    "npz weights": target(npz_weights, read_state, head=80),
    "safetensors": text("a.safetensors", WEIGHTS, read_state, head=80),
    "scores": target(score_file, read_scores),
    "clouds": target(clouds, load_clouds),
}
