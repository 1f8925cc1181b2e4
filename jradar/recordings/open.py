"""`open_recording`: the first of `READERS` that matches a path reads it.

`without_background` changes what was opened.
"""

import dataclasses
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

import jradar
from jradar.errors import UsageError
from jradar.files import open_file
from jradar.recordings import capture, cubes
from jradar.recordings.bags import raw
from jradar.recordings.coloradar import sequence
from jradar.recordings.points import bags, formats, oculii, tables
from jradar.recordings.recording import Recording, Stream, need_samples, read
from jradar.recordings.ti import dca1000, packet_trace

READERS = (  # points are known by their contents, samples by their names
    *(capture.READER, sequence.READER, *formats.READERS, oculii.READER),
    *(dca1000.READER, packet_trace.READER, cubes.READER, raw.READER),
)
COMPRESSED = (".gz", ".zip", ".zst", ".xz", ".bz2")


def is_recording(path: Path | str) -> bool:
    """True if a reader takes this path; of a bag, the index is read."""
    return any(reader.matches(Path(path)) for reader in READERS)


def recordings_in(
    folder: Path, *, endings: Collection[str] = (), depth: int = 2
) -> Iterator[Path]:
    """Yield the recordings in a folder, then those in the folders there.

    Files that end like a recording next to them, or with one of the `endings`, count,
    so that a damaged one is not passed over. What is hidden does not count.
    """
    shown = [p for p in sorted(folder.iterdir()) if not p.name.startswith(".")]
    known = {p for p in shown if is_recording(p)}
    alike = {*endings, *(p.suffix for p in known if not p.is_dir())}
    yield from (p for p in shown if p in known or not p.is_dir() and p.suffix in alike)
    for path in shown:
        if depth > 1 and path.is_dir() and path not in known:
            yield from recordings_in(path, endings=endings, depth=depth - 1)


def holds_points(path: Path | str) -> bool:
    """True for a recording of the points that a radar found."""
    path = Path(path)
    taken = next((reader for reader in READERS if reader.matches(path)), None)
    return taken in formats.READERS


def open_recording(
    path: Path | str,
    description: Path | str | None = None,
    *,
    sensor: str | None = None,
    frames_as_chirps: bool = False,
    iq_order: str | None = None,
    allow_partial: bool = False,
    device: str | None = None,
    topic: str | None = None,
) -> Recording:
    """Open a recording of any format in `READERS`; no frame is read yet.

    `description` is the file that describes the radar, or ColoRadar's `calib` folder;
    by default the only one next to the recording. `device` is the board of a .cfg,
    `sensor` the radar of a ColoRadar sequence, "single_chip" or "cascade", `iq_order`
    replaces the described order of I and Q, `topic` is that of a bag's points.
    `frames_as_chirps` merges frames of one chirp each into one frame, and
    `allow_partial` reads the whole frames of an adc_data.bin that was cut off. Raises
    UsageError for a path of no known format, an option that the format does not take,
    and a missing description; ValueError for damaged files.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such file or folder: {path}")
    if not path.is_dir():
        open_file(path).close()  # refuses pipes and devices
    if not is_recording(path):
        if path.suffix in COMPRESSED:
            raise UsageError(f"{path} is compressed, expected a recording: unpack it")
        if bags.holds_clouds(path):  # of no radar, unless the topic is named
            return bags.open_points_bag(path, topic=topic)
        if path.is_dir():
            _refuse_folder(path)
        tables.refuse(path)
    recording = read(
        path,
        READERS,
        description=description,
        sensor=sensor,
        iq_order=iq_order,
        allow_partial=allow_partial or None,
        device=device,
        topic=topic,
    )
    return _frames_as_chirps(recording) if frames_as_chirps else recording


def _refuse_folder(path: Path) -> None:
    inside = [*recordings_in(path)]
    if not inside:
        names = "; ".join(reader.name for reader in READERS)
        raise UsageError(f"{path} holds no recording, expected {names}")
    names = ", ".join(map(str, inside[:5]))
    more = f" and {len(inside) - 5} more" if len(inside) > 5 else ""
    raise UsageError(f"{path} is not a recording; name one inside it: {names}{more}")


def _frames_as_chirps(recording: Recording) -> Recording:
    need_samples(recording)
    radar, frames, lost = recording.radar.spec, recording.cubes, recording.lost_bytes
    if radar.num_chirps != 1 or radar.num_tx != 1 or not radar.frame_period_s:
        raise UsageError(
            f"{recording.path}: frames can serve as chirps only if each holds one "
            "chirp of one transmitter and their period is known; here a frame holds "
            f"{radar.num_chirps} chirps of {radar.num_tx} transmitters, period "
            f"{radar.frame_period_s} s"
        )
    slow = dataclasses.replace(
        radar,
        num_chirps=len(frames),
        idle_time_s=radar.frame_period_s - radar.ramp_end_time_s,
        frame_period_s=0.0,
    )
    return recording._replace(
        radar=dataclasses.replace(recording.radar, spec=slow),
        cubes=Stream(lambda _: np.concatenate([*frames], axis=2), 1),
        lost_bytes=None if lost is None else lost.sum(keepdims=True),
        notes=(*recording.notes, f"{len(frames)} frames were taken as chirps of one"),
    )


def without_background(recording: Recording, frames: slice) -> Recording:
    """Return the recording of a radar at rest without the static background.

    The background is the mean of `frames`. It contains the leakage, so that the
    radar's own is dropped.
    Raises UsageError if the recording has none of the frames.
    """
    need_samples(recording)
    cubes, chosen = recording.cubes, range(*frames.indices(len(recording.cubes)))
    if not chosen:
        raise UsageError(
            f"no background in frames {frames.start or 0} and later: {recording.path} "
            f"has frames 0 to {len(cubes) - 1}"
        )
    background = jradar.radar.static_background(cubes[i] for i in chosen)

    def read(frame: int) -> np.ndarray:
        return np.asarray(jradar.radar.subtract_background(cubes[frame], background))

    note = f"the mean of frames {chosen[0]} to {chosen[-1]} is subtracted as background"
    return recording._replace(
        cubes=Stream(read, len(cubes), cubes.stamps, cubes.notes),
        radar=dataclasses.replace(recording.radar, leakage=None),
        notes=(*recording.notes, note),
    )
