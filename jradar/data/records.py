"""Prepared frames on disk: ArrayRecord shards of safetensors bytes, and a manifest.

    DST/manifest.json                      sources, options, sequences and digests
    DST/<sequence>/0000.array_record       a block of the sequence's frames
    DST/<sequence>/0000.json               numbers of its radar frames, and its digest

A record contains preprocessed radar cells and points, not images: `PairSource` computes
images on reading, for any view, size and number of slices. A radar that sends points
has no cells. Records are read in any order. ArrayRecord checks each record when it is
read; `Records.verify` checks all.
"""

import contextlib
import errno
import functools
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import safetensors.numpy
from jaxtyping import Float

from jradar.errors import UsageError, optional, parsing
from jradar.fields import typed_fields
from jradar.files import DISK_FULL, atomic_path, inside, read_json, write_text
from jradar.lidar import LidarSpec
from jradar.radar import Cells, PointSpec, RadarSpec
from jradar.recordings.recording import Stream
from jradar.types import PointCloud

FORMAT = 1
WINDOWS = PointSpec.doppler_window, PointSpec.range_window
OPTIONS = "group_size:1,zstd:1"  # one record per group: larger groups shuffle slowly


class PreparedFrame(NamedTuple):
    """One radar frame and its LiDAR scan, as NumPy arrays."""

    sequence: str
    frame: int  # number of the radar frame in the sequence, from 0
    stamp: float  # time of the radar frame in seconds
    lidar_stamp: float
    world_from_radar: Float[np.ndarray, "4 4"]  # NaN without a trajectory
    cells: Cells | None  # the whole range-Doppler map; None of a radar's own points
    radar: PointCloud  # the condition's points, or the radar's own
    lidar_xyz: Float[np.ndarray, "point 3"]  # preprocessed, in the radar's frame
    range_bias_m: float = 0.0  # to subtract from the cells' ranges


package = functools.partial(
    optional, need="reading and writing records needs an extra", extra="data"
)


def to_bytes(frame: PreparedFrame) -> bytes:
    """Return a frame as safetensors bytes; the angles of cells become float16."""
    cells = {} if frame.cells is None else frame.cells._asdict()
    kinds = {"power": np.float32, "azimuth": np.float16, "elevation": np.float16}
    cells |= {name: kind(cells[name]) for name, kind in kinds.items() if name in cells}
    arrays = {
        "sequence": np.frombuffer(frame.sequence.encode(), np.uint8),
        "frame": np.int64(frame.frame),
        "stamps": np.array([frame.stamp, frame.lidar_stamp]),
        "world_from_radar": np.float64(frame.world_from_radar),
        "lidar_xyz": np.float32(frame.lidar_xyz),
        "range_bias_m": np.float64(frame.range_bias_m),
        **{f"cells.{name}": values for name, values in cells.items()},
        **{f"radar.{name}": values for name, values in frame.radar._asdict().items()},
    }
    known = {name: values for name, values in arrays.items() if values is not None}
    return safetensors.numpy.save(
        {name: np.asarray(values, order="C") for name, values in known.items()}
    )


def from_bytes(record: bytes) -> PreparedFrame:
    """Return the frame of `to_bytes`; raises ValueError for other bytes."""
    with parsing("the record", "a prepared frame"):
        arrays: dict[str, Any] = safetensors.numpy.load(record)
        parts: dict[str, dict[str, Any]] = {"cells": {}, "radar": {}}
        for name, values in arrays.items():
            part, _, field = name.partition(".")
            if field:
                parts[part][field] = values
        cells = Cells(**parts["cells"]) if parts["cells"] else None
        if cells is not None:
            angles = np.float32(cells.azimuth), np.float32(cells.elevation)
            cells = cells._replace(azimuth=angles[0], elevation=angles[1])
        stamp, lidar_stamp = arrays["stamps"].tolist()
        return PreparedFrame(
            sequence=arrays["sequence"].tobytes().decode(),
            frame=int(arrays["frame"]),
            stamp=stamp,
            lidar_stamp=lidar_stamp,
            world_from_radar=arrays["world_from_radar"],
            cells=cells,
            radar=PointCloud(**parts["radar"]),
            lidar_xyz=arrays["lidar_xyz"],
            range_bias_m=float(arrays.get("range_bias_m", 0.0)),
        )


def cells_of(frame: PreparedFrame) -> Cells:
    """Return the cells of a frame; UsageError for a frame of a radar's own points."""
    if frame.cells is None:
        raise UsageError(
            f"{frame.sequence}, frame {frame.frame}: the record holds a radar's own "
            "points, expected the cells of its samples: `jradar score` and `jradar "
            "finetune` take points"
        )
    return frame.cells


def write_shard(
    path: Path,
    frames: Iterable[PreparedFrame],
    about: dict[str, Any],
    failed: dict[str, str],
) -> dict[str, Any]:
    """Write one shard and its description: `about`, frame numbers, size and digest.

    `failed` may be filled while `frames` is consumed: {frame: error}.
    """
    array_record = package("array_record.python.array_record_module")
    numbers = []
    with atomic_path(path) as scratch:
        writer = array_record.ArrayRecordWriter(str(scratch), OPTIONS)
        try:
            for frame in frames:
                with _system_errors():
                    writer.write(to_bytes(frame))
                numbers.append(frame.frame)
        finally:
            with _system_errors():
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


@contextlib.contextmanager
def _system_errors() -> Iterator[None]:
    """Raise OSError for the RuntimeErrors of a writer of ArrayRecord."""
    try:
        yield
    except RuntimeError as error:
        for code in DISK_FULL:
            if (reason := os.strerror(code)) in str(error):
                raise OSError(code, reason) from error
        raise OSError(errno.EIO, str(error)) from error


def finished_shard(path: Path, about: dict[str, Any]) -> dict[str, Any] | None:
    """Return the description of a whole shard written for `about`; None without one."""
    try:
        description = read_json(path.with_suffix(".json"))
        _check(description, file=str, frames=list, failed=dict, bytes=int)
        content = path.read_bytes()
        same = {k: description[k] for k in about} == json.loads(json.dumps(about))
        whole = hashlib.sha256(content).hexdigest() == description["sha256"]
    except (OSError, ValueError, KeyError):
        return None
    return description if same and whole else None


def _check(values: Any, **kinds: type) -> None:
    """Raise ValueError if a field of a manifest is missing or of another type."""
    for name, kind in kinds.items():
        if type(values[name]) is not kind:
            found = f"{values[name]!r:.80}"
            raise ValueError(f"{name} is {found}, expected {kind.__name__}")


def is_records(path: Path | str) -> bool:
    """Return whether a folder was begun by `jradar prepare`."""
    try:
        found = read_json(Path(path) / "manifest.json")
    except (OSError, ValueError):
        return False
    return {"format", "options", "names"} <= found.keys()


class Records(Stream):
    """The prepared frames of a folder; ValueError on access to damaged bytes."""

    def __init__(
        self,
        folder: Path | str,
        split: str | None = None,
        *,
        choose: Callable[[str], bool] = lambda name: True,
    ):
        """Open all sequences, or the sequences of one `split`, by the manifest.

        Of these, only sequences whose name `choose` accepts are opened. Raises
        ValueError for a folder that is damaged, not complete or without frames
        of the split.
        """
        self.folder = Path(folder)
        self.manifest = read_json(self.folder / "manifest.json")
        if self.manifest.get("format") != FORMAT:
            raise ValueError(
                f"{folder} has format {self.manifest.get('format')}, expected "
                f"{FORMAT}: prepare it again"
            )
        if not self.manifest.get("complete"):
            raise ValueError(
                f"{folder} is not complete: run the same `jradar prepare` again"
            )
        sequences = self._sequences()
        chosen = (s for s in sequences if choose(s["name"]))
        self.sequences = [s for s in chosen if split in (None, s["split"])]
        if not self.sequences:
            splits = sorted({s["split"] for s in sequences})
            raise ValueError(
                f"{folder} has no sequences of {split=}, expected one of {splits}"
            )
        self.shards, self.where = [], []
        for sequence in self.sequences:
            self.shards += sequence["shards"]
            for shard in sequence["shards"]:
                self.where += [(sequence["name"], frame) for frame in shard["frames"]]
        paths = [self.folder / shard["file"] for shard in self.shards]
        for path, shard in zip(paths, self.shards, strict=True):
            size = path.stat().st_size if path.is_file() else 0
            if size != shard["bytes"]:
                raise ValueError(
                    f"{path} holds {size:,} bytes, expected {shard['bytes']:,} as in "
                    "the manifest: truncated or replaced?"
                )
        try:
            sources = package("grain").sources
            self._source = sources.ArrayRecordDataSource([*map(str, paths)])
        except (RuntimeError, ValueError) as error:
            raise ValueError(f"{folder} contains a damaged shard: {error}") from error
        if len(self._source) != len(self.where):
            raise ValueError(
                f"{folder} holds {len(self._source)} frames, its manifest lists "
                f"{len(self.where)}: prepare it again"
            )
        super().__init__(self._frame, len(self.where))

    def _sequences(self) -> list[dict[str, Any]]:
        """Return the manifest's sequences; ValueError for a damaged manifest."""
        path = self.folder / "manifest.json"
        with parsing(path, "a manifest of records"):
            self.radar = cast(RadarSpec, None)  # of points
            if not self.of_points:
                self.radar = RadarSpec.from_dict(self.manifest["radar"])
            self._other_radars = {
                name: RadarSpec.from_dict(entry["radar"])
                for entry in self.manifest.get("other_radars", [])
                for name in entry["sequences"]
            }
            self._windows = {
                entry["name"]: tuple(entry.get("windows", WINDOWS))
                for entry in self.manifest["sequences"]
            }
            typed_fields(LidarSpec, self.manifest["options"]["lidar"])
            for sequence in self.manifest["sequences"]:
                _check(sequence, name=str, split=str, shards=list)
                for shard in sequence["shards"]:
                    _check(shard, file=str, frames=list, bytes=int, sha256=str)
                    inside(self.folder, shard["file"], source=path)
        return self.manifest["sequences"]

    def _frame(self, index):
        try:
            frame = from_bytes(self._source[index])
        except (RuntimeError, ValueError) as error:
            sequence, frame = self.where[index]
            where = f"record {index} ({sequence}, frame {frame})"
            raise ValueError(f"{self.folder}, {where}: {error}") from error
        return frame._replace(sequence=self.where[index][0])  # NAME-end, of a part

    @property
    def of_points(self) -> bool:
        """Whether the frames are points that a radar sent, so that `radar` is None."""
        return self.manifest["radar"] is None

    def radar_of(self, sequence: str) -> RadarSpec:
        """Return the radar of a sequence; its antennas are those of `radar`."""
        return self._other_radars.get(sequence, self.radar)

    @property
    def other_radars(self) -> tuple[RadarSpec, ...]:
        """The other radars of these records, each once."""
        found = {self.radar_of(sequence): None for sequence, _ in self.where}
        return tuple(radar for radar in found if radar != self.radar)

    def windows_of(self, sequence: str) -> tuple[str, str]:
        """Return the windows of (doppler, range) of the cells of a sequence.

        Records of an older version do not name them, and have the windows of a
        `PointSpec`.
        """
        return self._windows.get(sequence, WINDOWS)

    @property
    def digest(self) -> str:
        """SHA-256 of the shards' digests, which identifies a training set."""
        digests = "".join(shard["sha256"] for shard in self.shards)
        return hashlib.sha256(digests.encode()).hexdigest()

    def verify(self) -> None:
        """Read every shard; raises ValueError for one that differs from its digest."""
        for shard in self.shards:
            path = self.folder / shard["file"]
            if hashlib.sha256(path.read_bytes()).hexdigest() != shard["sha256"]:
                raise ValueError(f"{path} does not match its digest: damaged?")
