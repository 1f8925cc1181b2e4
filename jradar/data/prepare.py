"""Recordings to a folder of prepared frames, on one or many processes.

The matched frames of a sequence are divided into blocks. Each block becomes one shard,
which is written atomically together with its description. Therefore a preparation that
was stopped resumes after its last complete shard, and any number of workers writes the
same bytes. One worker runs in this process; several run in a local Dask cluster, or in
the cluster at `scheduler`, whose machines must see the same files.

All sequences of a folder hold samples of the same antennas, or all hold points that a
radar sent. Chirps may differ: each sequence is processed with its own radar. The
manifest's `radar` is that of most sequences, and `other_radars` lists the others with
the names of their sequences. Of points, `radar` is null.
"""

import contextlib
import dataclasses
import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
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
    notes_of,
    prepare_frame,
    radar_side,
)
from jradar.data.records import FORMAT, finished_shard, write_shard
from jradar.data.sources import Source, find_sources
from jradar.data.spec import PrepareSpec
from jradar.errors import UsageError
from jradar.files import lock_folder, read_json, remove_leftovers, write_text
from jradar.progress import progress
from jradar.radar import Radar, RadarSpec
from jradar.recordings.recording import Recording
from jradar.workers import run_jobs

COMPARED = ("radar", "options", "frames", "names")  # fields of the manifest
OPTIONAL = ("other_radars",)  # compared, too, where there are any
ARRAY = (  # fields of radars whose frames may share a folder
    *("tx_positions", "rx_positions", "row_spacing", "design_frequency_hz"),
    "real_samples",
)


class Job(NamedTuple):
    """A shard to write, and what its description will name."""

    source: Source
    path: str
    about: dict[str, Any]

    @property
    def frames(self) -> int:
        """The number of matched frames."""
        return len(self.about["matched"][0])


def prepare(
    path: Path | str | Sequence[Path | str],
    folder: Path | str,
    spec: PrepareSpec,
    *,
    frames: slice = slice(None),
    workers: int = 2,
    scheduler: str | None = None,
    keep_going: bool = False,
    splits: Mapping[str, str] | None = None,
    validation_share: float = 0.0,
    **opening: Any,
) -> dict[str, Any]:
    """Prepare all recordings at `path` into `folder`; returns the manifest.

    `frames` selects frames of each sequence, and `opening` are keyword arguments of
    `open_recording`; `splits` and `validation_share` are as in `find_sources`, and may
    change later without preparing again. Frames in which a sensor saw nothing are
    dropped and counted; with `keep_going`, so are frames that cannot be read. A script
    with several workers needs `if __name__ == "__main__"` around the call. Raises
    UsageError for a folder with other contents, or with frames of another preparation;
    OSError if the disk is full, after which the same call resumes; ValueError for a
    frame that cannot be read (without `keep_going`), for a sequence that loses more
    than half of its frames to times or damage, and if no frame is left.
    """
    sources = find_sources(
        path, splits=splits, validation_share=validation_share, **opening
    )
    return prepare_sources(
        sources,
        folder,
        spec,
        frames=frames,
        workers=workers,
        scheduler=scheduler,
        keep_going=keep_going,
    )


def prepare_sources(
    sources: Sequence[Any],
    folder: Path | str,
    spec: PrepareSpec,
    *,
    frames: slice = slice(None),
    workers: int = 2,
    scheduler: str | None = None,
    keep_going: bool = False,
) -> dict[str, Any]:
    """Prepare these sources into `folder`, as `prepare` does; returns the manifest.

    A source is a `Source`, or any tuple with its name, split, `open` and `frames`.
    """
    folder = Path(folder).absolute()
    _check_contents(folder)  # before a lock is left there
    with lock_folder(folder):
        head = _head(sources, spec, frames)
        _check_options(folder, head)
        chosen = {source: _chosen(source, spec, frames) for source in sources}
        jobs = [
            job for s, found in chosen.items() for job in _jobs(s, found, folder, spec)
        ]
        _write_manifest(folder, head)
        shards, total = {}, sum(job.frames for job in jobs)
        there = {j.path for j in jobs if Path(j.path).with_suffix(".json").is_file()}
        done = sum(job.frames for job in jobs if job.path in there)
        write = functools.partial(prepare_block, spec=spec, keep_going=keep_going)
        _remove_leftovers(jobs)
        try:
            with (
                progress("preparing", total, first=done, unit="frames") as show,
                contextlib.closing(
                    run_jobs(write, jobs, workers=workers, scheduler=scheduler)
                ) as finished,  # closed: its processes have ended
            ):
                for job, shard in finished:
                    shards[job.path] = shard
                    done += 0 if job.path in there else job.frames
                    show(done, job.source.name)
        except BaseException:
            _remove_leftovers(jobs)
            raise
        summaries = []
        for source, found in chosen.items():
            ours = [shards[job.path] for job in jobs if job.source == source]
            summaries.append(_summary(source, found, ours, spec, frames))
        if not any(summary["frames"] for summary in summaries):
            reasons = dict.fromkeys(why for s in summaries for why in s["dropped"])
            names = ", ".join(source.name for source in sources[:3])
            raise ValueError(f"no usable frame in {names}: {', '.join(reasons)}")
        manifest = head | {"complete": True, "sequences": summaries}
        _write_manifest(folder, manifest)
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
    recording, failed = _opened(job.source), {}

    def frames():
        for i, j in zip(*job.about["matched"], strict=True):
            try:
                yield prepare_frame(recording, i, j, spec)[0]
            except EmptyFrame as error:
                failed[str(i)] = error.reason
            except ValueError as error:
                if not keep_going:
                    raise
                failed[str(i)] = str(error)

    return write_shard(path, frames(), job.about, failed)


def _write_manifest(folder, manifest):
    write_text(folder / "manifest.json", json.dumps(manifest, indent=1) + "\n")


def _remove_leftovers(jobs):
    """Remove half-written shards of workers that were killed."""
    for job in jobs:
        for suffix in (".array_record", ".json"):
            remove_leftovers(Path(job.path).with_suffix(suffix))


@functools.lru_cache(maxsize=4)
def _opened(source: Source) -> Recording:
    return source.open()


def _head(sources, spec, frames):
    """Return the manifest's part that determines the bytes of the shards.

    Its `radar` is that of most sequences. Raises UsageError for samples and points
    together, and ValueError for samples of radars with different antennas, and for
    options that do not suit one of them.
    """
    of_radar: dict[RadarSpec, list[str]] = {}
    of_points: list[str] = []
    for source in sources:
        recording = source.open()
        alike = of_points
        if not recording.of_points:
            alike = of_radar.setdefault(recording.radar.spec, [])
        alike.append(source.name)
    radars = sorted(of_radar, key=lambda radar: -len(of_radar[radar]))  # stable
    if of_points and radars:
        raise UsageError(
            f"{of_radar[radars[0]][0]} holds a radar's samples and {of_points[0]} the "
            "points that a radar sent, expected one kind: prepare them into different "
            "folders"
        )
    _check_radars(radars, of_radar, spec)
    head = {
        "format": FORMAT,
        "jradar": __version__,
        "complete": False,
        "radar": dataclasses.asdict(radars[0]) if radars else None,
        "options": dataclasses.asdict(spec),
        "frames": [frames.start, frames.stop],
        "names": [source.name for source in sources],
    }
    others = [
        {"radar": dataclasses.asdict(radar), "sequences": of_radar[radar]}
        for radar in radars[1:]
    ]
    return head | ({"other_radars": others} if others else {})


def _check_radars(radars, of_radar, spec):
    """Raise ValueError for radars whose antennas differ, and for unsuited options."""
    if len({tuple(getattr(r, name) for name in ARRAY) for r in radars}) > 1:
        names = [f"{r.name} {r.cube_shape} of {of_radar[r][0]}" for r in radars]
        raise ValueError(
            f"the sequences were recorded with {len(radars)} radars ({', '.join(names)}"
            ") whose antennas differ, expected one array: take the recordings of "
            "one radar at a time"
        )
    for radar in radars:
        dtype = np.float32 if radar.real_samples else np.complex64
        cube = jax.ShapeDtypeStruct(radar.cube_shape, dtype)
        jax.eval_shape(functools.partial(radar_side, spec=spec), cube, Radar(radar))


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

    A preparation that has not finished a shard may be replaced by another.
    """
    found, wanted = _check_contents(folder), json.loads(json.dumps(head))
    keys = (*COMPARED, *OPTIONAL)
    changed = [key for key in keys if found and found.get(key) != wanted.get(key)]
    if changed and any(folder.glob("*/*.array_record")):
        key = changed[0]
        change = _difference(key, found.get(key), wanted.get(key))
        raise UsageError(
            f"{folder} was prepared with other {key}: {change}; choose another -o"
        )


def _difference(key, old, new):
    """Return in words how two values of this field of the manifest differ."""
    if key in OPTIONAL:
        count = (len(listed or []) for listed in (old, new))
        return "{} were listed, now {} with other fields".format(*count)
    if key == "radar" and None in (old, new):
        kinds = ("points" if radar is None else "samples" for radar in (old, new))
        return "it holds records of {}, now of {}".format(*kinds)
    if key == "names":
        gone, added = sorted({*old} - {*new}), sorted({*new} - {*old})
        return f"{len(gone)} removed {gone[:3]}, {len(added)} added {added[:3]}"
    while isinstance(old, dict) and isinstance(new, dict):
        key = next(k for k in {**old, **new} if old.get(k) != new.get(k))
        old, new = old.get(key), new.get(key)
    return f"{key} was {old}, now {new}"


def _jobs(source, matches, folder, spec):
    """Yield the jobs of a source, one for each block of matched frames."""
    options = json.dumps(dataclasses.asdict(spec), sort_keys=True)
    digest = hashlib.sha256(options.encode()).hexdigest()
    for block, first in enumerate(range(0, len(matches.radar), spec.block)):
        part = slice(first, first + spec.block)
        about = {
            "sequence": source.name,
            "matched": [
                found[part].tolist() for found in (matches.radar, matches.lidar)
            ],
            "options_sha256": digest,
        }
        path = folder / source.name / f"{block:04d}.array_record"
        yield Job(source, str(path), about)


def _chosen(source, spec, frames):
    """Return the matches of selected frames; ValueError if too many are dropped."""
    recording = _opened(source)
    matches = matches_of(recording, spec)
    wanted = source.frames(recording, frames)
    if not wanted and source.part != (0.0, 1.0):
        raise UsageError(
            f"{source.name}: a recording of {len(recording.frames)} frames is too "
            "short to be cut into two parts: record longer, or name another recording "
            "by --validation"
        )
    dropped = {i: why for i, why in matches.dropped.items() if i in wanted}
    check_dropped(recording.name, len(wanted), dropped)
    keep = np.isin(matches.radar, wanted)
    return Matches(matches.radar[keep], matches.lidar[keep], dropped)


def _summary(source, matches, shards, spec, frames):
    """Return a sequence's manifest entry; ValueError if too many frames are lost."""
    recording, dropped = _opened(source), dict(matches.dropped)
    for shard in shards:
        dropped |= {int(i): why for i, why in shard["failed"].items()}
    count = len(source.frames(recording, frames))
    check_dropped(source.name, count, dropped)
    reasons = [*dropped.values()]
    keys = ("file", "frames", "bytes", "sha256")
    windows = {}
    if not recording.of_points:
        points = spec.points.subtracting(recording.radar.leakage)
        windows["windows"] = [points.doppler_window, points.range_window]
    return {
        "name": source.name,
        "split": source.split,
        "frames": sum(len(shard["frames"]) for shard in shards),
        "dropped": {why: reasons.count(why) for why in dict.fromkeys(reasons)},
        "notes": notes_of(recording),
        **windows,
        "shards": [{key: shard[key] for key in keys} for shard in shards],
    }
