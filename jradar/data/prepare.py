"""Recordings to a folder of prepared frames, on one or many processes.

The matched frames of a sequence are divided into blocks. Each block becomes one shard,
which is written atomically together with its description. Therefore a preparation that
was stopped resumes after its last complete shard, and any number of workers writes the
same bytes. One worker runs in this process; several run in a local Dask cluster, or in
the cluster at `scheduler`, whose machines must see the same files.
"""

import dataclasses
import functools
import hashlib
import json
import os
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jradar import __version__
from jradar.data.frames import Matches, check_dropped, matches_of, prepare_frame
from jradar.data.records import FORMAT, finished_shard, write_shard
from jradar.data.sources import Source, find_sources
from jradar.data.spec import PrepareSpec
from jradar.errors import UsageError
from jradar.files import lock_folder, read_json, write_text
from jradar.progress import progress
from jradar.recordings.recording import Recording


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
    `open_recording`. With `keep_going`, frames that cannot be read are dropped and
    counted. A script with several workers needs `if __name__ == "__main__"` around the
    call. Raises UsageError for a folder with other contents or of another preparation;
    ValueError for a frame that cannot be read (without `keep_going`), and for a
    sequence of which more than half of the frames are dropped.
    """
    folder = Path(folder).absolute()
    sources = find_sources(path, **opening)
    with lock_folder(folder):
        head = _head(sources, spec, frames)
        _check_options(folder, head)
        for scratch in folder.glob("*/.*-*"):  # left by a killed run
            shutil.rmtree(scratch)
        write_text(folder / "manifest.json", json.dumps(head, indent=1) + "\n")
        jobs = [job for s in sources for job in _jobs(s, folder, spec, frames)]
        descriptions, done = {}, 0
        total = sum(len(job.matches.radar) for job in jobs)
        with progress("preparing", total, unit="frames") as show:
            for job, description in _run(jobs, spec, keep_going, workers, scheduler):
                descriptions[job.path] = description
                done += len(job.matches.radar)
                show(done, job.source.name)
        summaries = [_summary(s, jobs, descriptions, spec, frames) for s in sources]
        manifest = head | {"complete": True, "sequences": summaries}
        write_text(folder / "manifest.json", json.dumps(manifest, indent=1) + "\n")
    return manifest


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
            except ValueError as error:
                if not keep_going:
                    raise
                failed[str(i)] = str(error)

    return write_shard(path, frames(), job.about, failed)


@functools.lru_cache(maxsize=4)
def _opened(source: Source) -> Recording:
    return source.open()


def _head(sources, spec, frames):
    """Return the manifest's part that determines the bytes of the shards."""
    radars = {source.open().radar for source in sources}
    if len(radars) > 1:
        names = sorted(f"{radar.name} {radar.cube_shape}" for radar in radars)
        raise ValueError(
            f"the sequences were recorded with {len(radars)} radars ({', '.join(names)}"
            "), expected one: prepare them into different folders"
        )
    return {
        "format": FORMAT,
        "jradar": __version__,
        "complete": False,
        "radar": dataclasses.asdict(radars.pop()),
        "options": dataclasses.asdict(spec),
        "frames": [frames.start, frames.stop],
        "names": [source.name for source in sources],
    }


def _check_options(folder, head):
    """Raise UsageError for a folder of other options, sources or contents."""
    path = folder / "manifest.json"
    if not path.exists() and any(entry.name != ".lock" for entry in folder.iterdir()):
        raise UsageError(
            f"{folder} is neither empty nor a folder of records: choose another -o"
        )
    wanted = json.loads(json.dumps(head))
    found = read_json(path) if path.exists() else wanted
    for key in ("radar", "options", "frames", "names"):
        if found.get(key) != wanted[key]:
            raise UsageError(
                f"{folder} was prepared with other {key}: "
                f"{_difference(found, wanted, key)}; choose another -o"
            )


def _difference(found, wanted, key):
    old, new = found.get(key), wanted[key]
    if isinstance(old, dict) and isinstance(new, dict):
        field = next(k for k in {**old, **new} if old.get(k) != new.get(k))
        return f"{field} was {old.get(field)}, now {new.get(field)}"
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
    return {
        "name": source.name,
        "split": source.split,
        "frames": sum(len(shard["frames"]) for shard in shards),
        "dropped": {why: reasons.count(why) for why in dict.fromkeys(reasons)},
        "notes": list(recording.notes),
        "shards": [{key: shard[key] for key in keys} for shard in shards],
    }


def _run(jobs, spec, keep_going, workers, scheduler):
    """Yield each finished job with the description of its shard."""
    if scheduler is None and workers == 1:
        for job in jobs:
            yield job, prepare_block(job, spec, keep_going)
        return
    with _client(workers, scheduler) as client:
        from distributed import as_completed

        futures = {
            client.submit(prepare_block, job, spec, keep_going, pure=False): job
            for job in jobs
        }
        for future in as_completed(futures):
            yield futures[future], future.result()


def _client(workers, scheduler):
    """Return a client of the scheduler, or of a new cluster on this machine."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ImportError("several workers need: pip install 'jradar[data]'") from error
    if scheduler is not None:
        return Client(scheduler, timeout=10)
    # Workers read files of this machine: they need no dashboard and only local sockets.
    return Client(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=None,
        host="127.0.0.1",
        local_directory=os.environ.get("TMPDIR", "/tmp"),
    )
