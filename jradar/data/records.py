"""Prepared frames on disk: ArrayRecord shards of safetensors bytes, and a manifest.

    DST/manifest.json                      what was prepared, from what, how; digests
    DST/<sequence>/0000.array_record       frames of a sequence, in blocks
    DST/<sequence>/0000.json               how many, from which radar frames; digest

A record holds what the sensors saw after preprocessing, not images: those are made on
reading (`pairs`), for whatever view, size and number of slices an experiment names.
Records are read at random; each is checked by ArrayRecord when it is read, and the
whole by `verify`.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import safetensors.numpy
from jaxtyping import Float

from jradar.files import atomic_path, write_text
from jradar.radar import Cells, RadarSpec
from jradar.types import PointCloud

FORMAT = 1
OPTIONS = "group_size:1,zstd:1"  # one record a group: the default makes shuffling slow
MAX_JSON_BYTES = 64 << 20
EXTRA = "reading and writing records needs: pip install 'jradar[data]'"


class PreparedFrame(NamedTuple):
    """One radar frame and the LiDAR scan that belongs to it, as NumPy arrays."""

    sequence: str
    frame: int  # of the sequence's radar, from 0
    stamp: float  # seconds, of the radar
    lidar_stamp: float
    world_from_radar: Float[np.ndarray, "4 4"]  # NaN where no trajectory is known
    cells: Cells  # of the whole range-Doppler map
    radar: PointCloud  # of the condition
    lidar_xyz: Float[np.ndarray, "point 3"]  # preprocessed, in the radar's frame
    range_bias_m: float = 0.0  # by how much the cells' ranges are too long


def to_bytes(frame: PreparedFrame) -> bytes:
    """A frame as safetensors; angles of cells as float16, all else as it is."""
    arrays = {
        "sequence": np.frombuffer(frame.sequence.encode(), np.uint8),
        "frame": np.array(frame.frame, np.int64),
        "stamps": np.array([frame.stamp, frame.lidar_stamp], np.float64),
        "world_from_radar": np.asarray(frame.world_from_radar, np.float64),
        "lidar_xyz": np.asarray(frame.lidar_xyz, np.float32),
        "range_bias_m": np.array(frame.range_bias_m, np.float64),
        "cells.power": np.asarray(frame.cells.power, np.float32),
        "cells.azimuth": np.asarray(frame.cells.azimuth, np.float16),
        "cells.elevation": np.asarray(frame.cells.elevation, np.float16),
    }
    for name, value in frame.radar._asdict().items():
        arrays[f"radar.{name}"] = np.asarray(value)
    return safetensors.numpy.save(
        {name: np.asarray(value, order="C") for name, value in arrays.items()}
    )


def from_bytes(record: bytes) -> PreparedFrame:
    """The frame of `to_bytes`; ValueError for bytes that are none."""
    try:
        arrays: dict[str, Any] = safetensors.numpy.load(record)
        stamp, lidar_stamp = arrays["stamps"].tolist()
        return PreparedFrame(
            sequence=arrays["sequence"].tobytes().decode(),
            frame=int(arrays["frame"]),
            stamp=stamp,
            lidar_stamp=lidar_stamp,
            world_from_radar=arrays["world_from_radar"],
            cells=Cells(
                power=arrays["cells.power"],
                azimuth=arrays["cells.azimuth"].astype(np.float32),
                elevation=arrays["cells.elevation"].astype(np.float32),
            ),
            radar=PointCloud(**{k: arrays[f"radar.{k}"] for k in PointCloud._fields}),
            lidar_xyz=arrays["lidar_xyz"],
            range_bias_m=float(arrays.get("range_bias_m", 0.0)),
        )
    except (safetensors.SafetensorError, KeyError, UnicodeDecodeError) as error:
        raise ValueError(f"a record is not a prepared frame: {error}") from error


def write_shard(
    path: Path,
    frames: Iterable[PreparedFrame],
    about: dict[str, Any],
    failed: dict[str, str],
) -> dict[str, Any]:
    """Write one shard, then its description `about` with count, size and digest.

    `failed` holds the frames that could not be prepared, once `frames` has run out.
    """
    module = _array_record()
    numbers = []
    with atomic_path(path) as scratch:
        writer = module.ArrayRecordWriter(str(scratch), OPTIONS)
        try:
            for frame in frames:
                writer.write(to_bytes(frame))
                numbers.append(frame.frame)
        finally:
            writer.close()
        content = scratch.read_bytes()
    description = about | {
        "file": f"{path.parent.name}/{path.name}",
        "frames": numbers,
        "failed": failed,
        "bytes": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    write_text(path.with_suffix(".json"), json.dumps(description) + "\n")
    return description


def finished_shard(path: Path, about: dict[str, Any]) -> dict[str, Any] | None:
    """The description of a shard that stands whole at `path`, made from `about`."""
    try:
        description = read_json(path.with_suffix(".json"))
        content = path.read_bytes()
        same = {k: description[k] for k in about} == json.loads(json.dumps(about))
        whole = hashlib.sha256(content).hexdigest() == description["sha256"]
    except (OSError, ValueError, KeyError):
        return None
    return description if same and whole else None


def read_json(path: Path | str) -> dict[str, Any]:
    """A JSON object of bounded size."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such file: {path}")
    if path.stat().st_size > MAX_JSON_BYTES:
        raise ValueError(f"{path} is larger than {MAX_JSON_BYTES:,} bytes")
    try:
        values = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(values, dict):
        raise ValueError(f"{path} holds a {type(values).__name__}, expected an object")
    return values


class Records(Sequence):
    """Prepared frames by index, read when asked for; opening reads the manifest."""

    def __init__(self, folder: Path | str, split: str | None = None):
        """Frames of all sequences, or of those of one `split`."""
        self.folder = Path(folder)
        self.manifest = read_json(self.folder / "manifest.json")
        if self.manifest.get("format") != FORMAT:
            raise ValueError(
                f"{folder} has format {self.manifest.get('format')}, expected "
                f"{FORMAT}: prepare it again"
            )
        if not self.manifest.get("complete"):
            raise ValueError(
                f"{folder} is not complete: start the same `jradar prepare` again"
            )
        self.radar = RadarSpec.from_dict(_tuples(self.manifest["radar"]))
        splits = [s["split"] for s in self.manifest["sequences"]]
        self.sequences = [
            sequence
            for sequence in self.manifest["sequences"]
            if split in (None, sequence["split"])
        ]
        if not self.sequences:
            raise ValueError(
                f"{folder} has no sequences for {split=}, only {sorted({*splits})}"
            )
        shards = [shard for s in self.sequences for shard in s["shards"]]
        self.where = [
            (sequence["name"], frame)
            for sequence in self.sequences
            for shard in sequence["shards"]
            for frame in shard["frames"]
        ]
        try:
            import grain
        except ImportError as error:
            raise ImportError(EXTRA) from error
        for shard in shards:
            size = _size(self.folder / shard["file"])
            if size != shard["bytes"]:
                raise ValueError(
                    f"{self.folder / shard['file']} holds {size:,} bytes, the manifest "
                    f"says {shard['bytes']:,}: truncated or replaced?"
                )
        try:
            self._source = grain.sources.ArrayRecordDataSource(
                [str(self.folder / shard["file"]) for shard in shards]
            )
        except RuntimeError as error:
            raise ValueError(f"{folder} holds a damaged shard: {error}") from error

    def __len__(self) -> int:
        return len(self.where)

    def __getitem__(self, index: int | slice) -> Any:
        """Frame `index`; ValueError where its bytes are damaged."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        try:
            return from_bytes(self._source[index % len(self)])
        except (RuntimeError, ValueError) as error:
            sequence, frame = self.where[index]
            raise ValueError(
                f"{self.folder}, {sequence}, frame {frame}: {error}"
            ) from error

    @property
    def digest(self) -> str:
        """SHA-256 over the shards' digests: what a run was trained on."""
        shards = (shard["sha256"] for s in self.sequences for shard in s["shards"])
        return hashlib.sha256("".join(shards).encode()).hexdigest()

    def verify(self) -> None:
        """Read every shard; ValueError for the first that differs from its digest."""
        for sequence in self.sequences:
            for shard in sequence["shards"]:
                path = self.folder / shard["file"]
                if hashlib.sha256(path.read_bytes()).hexdigest() != shard["sha256"]:
                    raise ValueError(f"{path} does not match its digest: damaged?")


def _array_record():
    """The module that writes ArrayRecord files."""
    try:
        from array_record.python import array_record_module  # type: ignore
    except ImportError as error:
        raise ImportError(EXTRA) from error
    return array_record_module


def _size(path):
    """Bytes of a file, 0 if there is none."""
    return path.stat().st_size if path.is_file() else 0


def _tuples(value: Any) -> Any:
    """Lists of JSON as tuples."""
    if isinstance(value, list):
        return tuple(map(_tuples, value))
    if isinstance(value, dict):
        return {k: _tuples(v) for k, v in value.items()}
    return value
