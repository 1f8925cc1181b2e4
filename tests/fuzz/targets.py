"""The readers, each with a small valid file to damage."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jradar.data import PrepareSpec, Records, find_sources
from jradar.diffusion.weights.files import read_state
from jradar.evaluation import read_scores, save_clouds, write_scores
from jradar.evaluation.report import load_clouds
from jradar.export import export_function, load_function
from jradar.model import load_model, save_model
from jradar.radar import Radar
from jradar.recordings import describe, open_recording
from jradar.recordings.bags.bags import bag_topics, open_bag
from jradar.recordings.clouds.read import read_cloud
from jradar.recordings.descriptions import read_description
from jradar.recordings.text_files import read_tum
from tests.data.prepared import invented_frame
from tests.data.test_records import write_folder
from tests.evaluation.invented import scores
from tests.models import RADAR, tiny_model
from tests.recordings import (
    bag_writer as bags,
    cube_writer,
    small_sequence,
)
from tests.recordings.bags import test_raw as raw_bags
from tests.recordings.clouds.test_read import pcd, ply
from tests.recordings.coloradar_writer import coupling_text, phases_text
from tests.recordings.dca1000_writer import (
    CFG,
    as_bytes,
    as_packets,
    random_cubes,
    with_headers,
)
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
SPEC = (
    "block = 4\n[points]\ncapacity = 64\nguard = [1, 2]\n[lidar]\nmax_range_m = 7.0\n"
)


class Target(NamedTuple):
    """A file to damage, its reader, and the length of its binary header."""

    path: Path
    read: Callable[[], Any]
    head: int = 0


def text(name: str, content: str | bytes, read: Callable[[Path], Any]) -> Callable:
    """Return a maker of a target that is one file."""

    def make(folder: Path) -> Target:
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return Target(path, lambda: read(path))

    return make


def described(path: Path) -> None:
    """Open a recording, describe it, and read its first and last frame."""
    recording = open_recording(path)
    describe(recording)
    for index in (0, -1):
        assert recording.cubes[index].ndim == 4


def cube(pairs: bool) -> Callable:
    """Return a maker of a .npy cube, complex or of int16 pairs."""

    def make(folder: Path) -> Target:
        array = cube_writer.random_cube()
        if pairs:
            array = np.stack([array.real, array.imag], -1).astype(np.int16)
        path = cube_writer.save(folder, array)
        return Target(path, lambda: described(path), 128)

    return make


def cube_toml(folder: Path) -> Target:
    """The description of a cube, with its axes."""
    path = cube_writer.save(folder, cube_writer.random_cube(), cube_writer_axes())
    return Target(folder / "radar.toml", lambda: described(path))


def cube_writer_axes() -> list[str]:
    """The axes of `random_cube`."""
    return ["tx", "rx", "chirp", "sample"]


def studio(name: str, content: str = "") -> Callable:
    """Return a maker of a file beside, or of, samples of mmWave Studio."""

    def make(folder: Path) -> Target:
        samples = cube_writer.random_cube((3, *cube_writer.SHAPE))
        path = cube_writer.save_studio(folder, samples)
        (folder / "poses.txt").write_text(POSES)
        opened = path
        if content:
            (folder / name).write_text(content)
            opened = folder if name == "capture.toml" else path
        return Target(folder / name, lambda: described(opened))

    return make


def packets(folder: Path) -> Target:
    """Packets of a DCA1000 with headers."""
    (folder / "radar.cfg").write_text(CFG)
    path = folder / "adc_data_Raw_0.bin"
    path.write_bytes(with_headers(as_packets(as_bytes(random_cubes()))))
    return Target(path, lambda: described(path), 14)


def trace(name: str) -> Callable:
    """Return a maker of packets of a DCA1000 in a trace of the network."""

    def make(folder: Path) -> Target:
        frames = [traces.datagram(packet) for packet in traces.packets()]
        path = traces.trace(folder, frames, name)
        return Target(path, lambda: described(path), 40)

    return make


def raw_bag(folder: Path) -> Target:
    """Raw samples in a bag."""
    path = raw_bags.write(folder)
    return Target(path, lambda: described(path))


def coloradar(*parts: str) -> Callable:
    """Return a maker of a file of a ColoRadar sequence; the rest stays whole."""

    def make(folder: Path) -> Target:
        sequence = small_sequence.write_sequence(folder, frames=2)
        calib, channels = folder / "calib" / "single_chip", np.ones((3, 4))
        coupling = coupling_text(np.full((3, 4, 32), 1.5 + 1.5j))
        (calib / "coupling_calib.txt").write_text(coupling)
        phases = phases_text(channels, channels * (1 + 0.5j))
        (calib / "phase_frequency_calib.txt").write_text(phases)
        return Target(folder.joinpath(*parts), lambda: described(sequence))

    return make


def splits(folder: Path) -> Target:
    """The splits of a folder of sequences."""
    (folder / "run0" / "single_chip" / "adc_samples" / "data").mkdir(parents=True)
    small_sequence.write_splits(folder, {"run0": "train"})
    return Target(folder / "splits.json", lambda: find_sources(folder))


def bag(container: str, compressed: str, name: str = "") -> Callable:
    """Return a maker of a bag with clouds of two kinds; `name` is a file beside it."""

    def make(folder: Path) -> Target:
        rows = bags.livox_rows(20)
        messages = [
            ("/l", bags.LIVOX, bags.START + i, bags.livox(rows, bags.START + i))
            for i in range(3)
        ]
        made = bags.point_cloud2(bags.columns(20), bags.START)
        messages.append(("/p", bags.CLOUD, bags.START, made))
        path = bags.write_bag(folder / "bag", container, messages, compressed)

        def read() -> None:
            for topic in bag_topics(path):
                stream = open_bag(path, topic=topic)
                for index in range(len(stream)):
                    assert stream[index].shape[1] == 4

        return Target(path / name if name else bags.files_of(path)[0], read)

    return make


def records(*parts: str) -> Callable:
    """Return a maker of a file of prepared records."""

    def make(folder: Path) -> Target:
        write_folder(folder)

        def read() -> None:
            found = Records(folder)
            assert found[len(found) - 1].radar.xyz.ndim == 2
            found.verify()

        return Target(folder.joinpath(*parts), read)

    return make


def model(name: str, head: int = 0) -> Callable:
    """Return a maker of a file of a model's folder."""

    def make(folder: Path) -> Target:
        save_model(folder / "model", tiny_model())
        path = folder / "model" / name
        return Target(path, lambda: load_model(folder / "model"), head)

    return make


def exported(folder: Path) -> Target:
    """An exported function."""
    path = folder / "model.jradar"
    export_function(path, Radar(RADAR), tiny_model(method="regression"))
    return Target(path, lambda: load_function(path), 300)


def weights(name: str) -> Callable:
    """Return a maker of published weights."""

    def make(folder: Path) -> Target:
        path, state = folder / name, {"a.weight": np.ones((4, 3), np.float32)}
        if name.endswith(".npz"):
            np.savez(path, **state)
        else:
            import safetensors.numpy

            safetensors.numpy.save_file(state, path)
        return Target(path, lambda: read_state(path), 80)

    return make


def clouds(folder: Path) -> Target:
    """Clouds of an evaluation."""
    path = folder / "clouds.npz"
    named = {"jradar": np.ones((4, 4)), "LiDAR": np.ones((5, 3))}
    save_clouds(path, {("Hallways", "run0", 3): named})
    return Target(path, lambda: load_clouds(path))


def score_file(folder: Path) -> Target:
    """Scores of an evaluation."""
    path = folder / "scores.jsonl"
    write_scores(path, scores(frames=3))
    return Target(path, lambda: read_scores(path))


def shard(folder: Path) -> Target:
    """A record of one frame, below the checks of its shard."""
    from jradar.data.records import from_bytes, to_bytes

    path = folder / "frame.safetensors"
    path.write_bytes(to_bytes(invented_frame(0)))

    def read() -> None:
        try:
            from_bytes(path.read_bytes())
        except ValueError as error:  # `Records` adds the name of the shard
            raise ValueError(f"{path}: {error}") from error

    return Target(path, read, 600)


CHIP = ("calib", "single_chip")
RUN = ("run0", "single_chip", "adc_samples")
TARGETS: dict[str, Callable[[Path], Target]] = {
    "radar.toml": text("radar.toml", cube_writer.RADAR, read_description),
    "radar.cfg": text("radar.cfg", CFG, read_description),
    "studio log": text("LogFile.txt", cube_writer.LOG + SECOND, read_description),
    "mmwave.json": text("a.mmwave.json", json.dumps(STUDIO), read_description),
    "capture.toml": studio("capture.toml", CAPTURE),
    "samples": studio("adc_data.bin"),
    "packets": packets,
    "trace": trace("trace.pcap"),
    "trace ng": trace("trace.pcapng"),
    "raw bag": raw_bag,
    "cube": cube(pairs=False),
    "cube of pairs": cube(pairs=True),
    "cube's toml": cube_toml,
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
    "splits": splits,
    "pcd ascii": text("a.pcd", pcd("ascii"), read_cloud),
    "pcd binary": text("a.pcd", pcd("binary"), read_cloud),
    "pcd packed": text("a.pcd", pcd("binary_compressed"), read_cloud),
    "ply ascii": text("a.ply", ply("ascii", lists=True), read_cloud),
    "ply binary": text("a.ply", ply("binary_little_endian", lists=True), read_cloud),
    "kitti": text("a.bin", np.ones((20, 4), "<f4").tobytes(), read_cloud),
    "bag": bag("bag", ""),
    "bag bz2": bag("bag", "bz2"),
    "bag lz4": bag("bag", "lz4"),
    "sqlite": bag("sqlite", ""),
    "bag's metadata": bag("sqlite", "", "metadata.yaml"),
    "sqlite zstd": bag("sqlite", "message"),
    "mcap": bag("mcap", ""),
    "mcap zstd": bag("mcap", "storage"),
    "manifest": records("manifest.json"),
    "shard": records("run0", "0000.array_record"),
    "record": shard,
    "prepare's toml": text("spec.toml", SPEC, PrepareSpec.from_toml),
    "model.json": model("model.json"),
    "model's weights": model("weights.safetensors", 200),
    "exported": exported,
    "npz weights": weights("a.npz"),
    "safetensors": weights("a.safetensors"),
    "scores": score_file,
    "clouds": clouds,
}
