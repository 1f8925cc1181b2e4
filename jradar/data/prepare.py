"""Recordings to a folder of prepared frames, on one or many processes.

The matched frames of a sequence are divided into blocks. Each block becomes one shard,
which is written atomically together with its description. Therefore a preparation that
was stopped resumes after its last complete shard, and any number of workers writes the
same bytes. One worker runs in this process; several run in a local Dask cluster, or in
the cluster at `scheduler`, whose machines must see the same files.

All sequences of a folder have the same antennas. Chirps may differ: each sequence is
processed with its own radar. The manifest's `radar` is that of most sequences, and
`other_radars` lists the others with the names of their sequences.
"""

import contextlib
import dataclasses
import functools
import hashlib
import json
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar import __version__
from jradar.data.frames import (
    EmptyFrame,
    Matches,
    check_dropped,
    matches_of,
    prepare_frame,
    radar_side,
)
from jradar.data.records import FORMAT, finished_shard, write_shard
from jradar.data.sources import Source, find_sources
from jradar.data.spec import PrepareSpec
from jradar.data.workers import run_jobs
from jradar.errors import UsageError
from jradar.files import lock_folder, read_json, remove_leftovers, write_text
from jradar.progress import progress
from jradar.radar import Radar, RadarSpec
from jradar.recordings.recording import Recording

COMPARED = ("radar", "options", "frames", "names")  # fields of the manifest
OPTIONAL = ("other_radars",)  # compared, too, where there are any
ARRAY = (  # fields of radars whose frames may share a folder
    *("tx_positions", "rx_positions", "row_spacing", "design_frequency_hz"),
    "real_samples",
)


class Job(NamedTuple):
    """A shard to write, and the matched frames that it will contain."""

    source: Source
    matches: Matches
    path: str
    about: dict[str, Any]


def prepare(
    path: Path | str,
    folder: Path | str,
    spec: PrepareSpec,
    *,
    frames: slice = slice(None),
    workers: int = 2,
    scheduler: str | None = None,
    keep_going: bool = False,
    **opening: Any,
) -> dict[str, Any]:
    """Prepare all recordings at `path` into `folder`; returns the manifest.

    `frames` selects frames of each sequence, and `opening` are keyword arguments of
    `open_recording`. Frames in which a sensor saw nothing are dropped and counted; with
    `keep_going`, so are frames that cannot be read. A script with several workers needs
    `if __name__ == "__main__"` around the call. Raises UsageError for a folder with
    other contents, or with frames of another preparation; OSError if the disk is full,
    after which the same call resumes; ValueError for a frame that cannot be read
    (without `keep_going`), for a sequence that loses more than half of its frames to
    times or damage, and if no frame is left.
    """
    folder = Path(folder).absolute()
    sources = find_sources(path, **opening)
    _check_contents(folder)  # before a lock is left there
    with lock_folder(folder):
        of_radar = _radars(sources)
        head = _head(sources, of_radar, spec, frames)
        _check_options(folder, head)
        jobs = [job for s in sources for job in _jobs(s, folder, spec, frames)]
        _try_options(of_radar, spec)
        write_text(folder / "manifest.json", json.dumps(head, indent=1) + "\n")
        descriptions, done = {}, 0
        total = sum(len(job.matches.radar) for job in jobs)
        write = functools.partial(prepare_block, spec=spec, keep_going=keep_going)
        _remove_leftovers(jobs)
        try:
            with (
                progress("preparing", total, unit="frames") as show,
                closing(
                    run_jobs(write, jobs, workers=workers, scheduler=scheduler)
                ) as finished,  # closed: its processes have ended
            ):
                for job, description in finished:
                    descriptions[job.path] = description
                    done += len(job.matches.radar)
                    show(done, job.source.name)
        except BaseException:
            _remove_leftovers(jobs)
            raise
        summaries = [_summary(s, jobs, descriptions, spec, frames) for s in sources]
        if not any(summary["frames"] for summary in summaries):
            reasons = dict.fromkeys(why for s in summaries for why in s["dropped"])
            raise ValueError(f"{path} has no usable frame: {', '.join(reasons)}")
        manifest = head | {"complete": True, "sequences": summaries}
        write_text(folder / "manifest.json", json.dumps(manifest, indent=1) + "\n")
    return manifest


def describe_manifest(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return the frames of each sequence, why others were dropped, and notes."""
    sequences = manifest["sequences"]
    return {
        "frames": sum(s["frames"] for s in sequences),
        "sequences": [
            {name: s[name] for name in ("name", "split", "frames")}
            | {"dropped": sum(s["dropped"].values())}
            for s in sequences
        ],
        "dropped": [
            {"sequence": s["name"], "frames": count, "reason": reason}
            for s in sequences
            for reason, count in s["dropped"].items()
        ],
        "notes": [f"{s['name']}: {note}" for s in sequences for note in s["notes"]],
    }


def prepare_block(job: Job, spec: PrepareSpec, keep_going: bool) -> dict[str, Any]:
    """Write the shard of a job if it is missing, and return its description."""
    path = Path(job.path)
    if (found := finished_shard(path, job.about)) is not None:
        return found
    recording = _opened(job.source)
    failed = {}

    def frames():
        for i, j in zip(job.matches.radar, job.matches.lidar, strict=True):
            try:
                yield prepare_frame(recording, int(i), int(j), spec)[0]
            except EmptyFrame as error:
                failed[str(i)] = error.reason
            except ValueError as error:
                if not keep_going:
                    raise
                failed[str(i)] = str(error)

    return write_shard(path, frames(), job.about, failed)


def _remove_leftovers(jobs):
    """Remove half-written shards of workers that were killed."""
    for job in jobs:
        for suffix in (".array_record", ".json"):
            remove_leftovers(Path(job.path).with_suffix(suffix))


def _try_options(radars, spec):
    """Trace the processing of a frame; ValueError for options that do not suit it."""
    for radar in map(Radar, radars):
        dtype = np.float32 if radar.spec.real_samples else np.complex64
        cube = jax.ShapeDtypeStruct(radar.spec.cube_shape, dtype)
        jax.eval_shape(functools.partial(radar_side, spec=spec), cube, radar)


@functools.lru_cache(maxsize=4)
def _opened(source: Source) -> Recording:
    return source.open()


def _radars(sources) -> dict[RadarSpec, list[str]]:
    """Return the sequences of each radar, that of most first.

    Raises ValueError for radars with different antennas.
    """
    of_radar: dict[RadarSpec, list[str]] = {}
    for source in sources:
        of_radar.setdefault(source.open().radar.spec, []).append(source.name)
    radars = sorted(of_radar, key=lambda radar: -len(of_radar[radar]))  # stable
    if len({tuple(getattr(r, name) for name in ARRAY) for r in radars}) > 1:
        names = sorted(f"{radar.name} {radar.cube_shape}" for radar in radars)
        raise ValueError(
            f"the sequences were recorded with {len(radars)} radars ({', '.join(names)}"
            ") whose antennas differ, expected one array: prepare them into different "
            "folders"
        )
    return {radar: of_radar[radar] for radar in radars}


def _head(sources, of_radar, spec, frames):
    """Return the manifest's part that determines the bytes of the shards."""
    most, *others = of_radar
    return {
        "format": FORMAT,
        "jradar": __version__,
        "complete": False,
        "radar": dataclasses.asdict(most),
        "options": dataclasses.asdict(spec),
        "frames": [frames.start, frames.stop],
        "names": [source.name for source in sources],
        **_other_radars(others, of_radar),
    }


def _other_radars(radars, of_radar):
    """Return the manifest's entry of radars with other chirps than most sequences'."""
    listed = [
        {"radar": dataclasses.asdict(radar), "sequences": of_radar[radar]}
        for radar in radars
    ]
    return {"other_radars": listed} if listed else {}


def _check_contents(folder) -> dict[str, Any]:
    """Return the manifest, {} in an empty folder; UsageError for other contents."""
    found = {}
    with contextlib.suppress(FileNotFoundError, ValueError):  # somebody else's
        found = read_json(folder / "manifest.json")
    entries = folder.iterdir() if folder.exists() else ()
    shown = sorted(entry.name for entry in entries if entry.name != ".lock")
    if shown and not set(COMPARED) <= set(found):
        raise UsageError(
            f"{folder} is neither empty nor a folder of records, it holds {shown[0]}: "
            "choose another -o"
        )
    return found


def _check_options(folder, head):
    """Raise UsageError for a folder of other options, sources or contents.

    A preparation that has not finished a shard loses its claim on the folder.
    """
    found = _check_contents(folder)
    wanted = json.loads(json.dumps(head))
    keys = (*COMPARED, *OPTIONAL)
    changed = [key for key in keys if found and found.get(key) != wanted.get(key)]
    if changed and any(folder.glob("*/*.array_record")):
        raise UsageError(
            f"{folder} was prepared with other {changed[0]}: "
            f"{_difference(found, wanted, changed[0])}; choose another -o"
        )


def _difference(found, wanted, key):
    old, new = found.get(key), wanted.get(key)
    if key in OPTIONAL:
        count = (len(listed or []) for listed in (old, new))
        return "{} were listed, now {} with other fields".format(*count)
    if isinstance(old, dict) and isinstance(new, dict):
        field = next(k for k in {**old, **new} if old.get(k) != new.get(k))
        inner = _difference(old, new, field)  # of a spec within a spec, its own field
        return inner if " was " in inner else f"{field} was {inner}"
    if key == "names":
        gone, added = sorted({*old} - {*new}), sorted({*new} - {*old})
        return f"{len(gone)} removed {gone[:3]}, {len(added)} added {added[:3]}"
    return f"{old}, now {new}"


def _jobs(source, folder, spec, frames):
    """Yield the jobs of a source, one for each block of matched frames."""
    matches = _chosen(_opened(source), spec, frames)
    options = json.dumps(dataclasses.asdict(spec), sort_keys=True)
    digest = hashlib.sha256(options.encode()).hexdigest()
    for block, first in enumerate(range(0, len(matches.radar), spec.block)):
        part = slice(first, first + spec.block)
        radar, lidar = matches.radar[part], matches.lidar[part]
        about = {
            "sequence": source.name,
            "matched": [radar.tolist(), lidar.tolist()],
            "options_sha256": digest,
        }
        path = folder / source.name / f"{block:04d}.array_record"
        yield Job(source, Matches(radar, lidar, {}), str(path), about)


def _chosen(recording, spec, frames):
    """Return the matches of selected frames; ValueError if too many are dropped."""
    matches = matches_of(recording, spec)
    wanted = range(*frames.indices(len(recording.cubes)))
    dropped = {i: why for i, why in matches.dropped.items() if i in wanted}
    check_dropped(recording.name, len(wanted), dropped)
    keep = np.isin(matches.radar, wanted)
    return Matches(matches.radar[keep], matches.lidar[keep], dropped)


def _summary(source, jobs, descriptions, spec, frames):
    """Return a sequence's manifest entry; ValueError if too many frames are lost."""
    recording = _opened(source)
    shards = [descriptions[job.path] for job in jobs if job.source == source]
    dropped = _chosen(recording, spec, frames).dropped
    for shard in shards:
        dropped |= {int(i): why for i, why in shard["failed"].items()}
    count = len(range(*frames.indices(len(recording.cubes))))
    check_dropped(source.name, count, dropped)
    reasons = [*dropped.values()]
    keys = ("file", "frames", "bytes", "sha256")
    points = spec.points.subtracting(recording.radar.leakage)
    return {
        "name": source.name,
        "split": source.split,
        "frames": sum(len(shard["frames"]) for shard in shards),
        "dropped": {why: reasons.count(why) for why in dict.fromkeys(reasons)},
        "notes": list(recording.notes),
        "windows": [points.doppler_window, points.range_window],
        "shards": [{key: shard[key] for key in keys} for shard in shards],
    }
