"""Recordings to prepared frames: matching, radar points, what of the LiDAR is visible.

The work is cut into blocks of a sequence's matched frames; each becomes one shard, is
written in one step and described beside it, so that a preparation that was stopped goes
on where it stood, and any number of workers writes the same bytes. One worker runs in
this process; several run in Dask's local cluster, or in the cluster at `scheduler`,
whose machines must see the same files.
"""

import contextlib
import dataclasses
import functools
import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar import __version__
from jradar.data.matching import Matches, check_dropped, match_nearest
from jradar.data.recording import Recording, calibrated_cube
from jradar.data.records import (
    FORMAT,
    PreparedFrame,
    finished_shard,
    read_json,
    write_shard,
)
from jradar.data.sources import Source, find_sources
from jradar.files import lock_folder, write_text
from jradar.lidar import LidarSpec, LidarSteps, interpolate_poses, preprocess
from jradar.progress import progress
from jradar.radar import (
    DETECTORS,
    Cells,
    RadarSpec,
    all_cells,
    cell_points,
    largest_window,
)
from jradar.types import PointCloud


@dataclasses.dataclass(frozen=True)
class PrepareSpec:
    """How frames are prepared; the manifest holds it.

    The visibility filter needs radar points that can be trusted, so it has a detection
    rate of its own; the condition's approaches 1 (section III-A).
    """

    capacity: int = 1024  # points of the radar cloud
    detector: str = "os"
    false_alarm_rate: float = 1.0
    visible_false_alarm_rate: float = 1e-3
    guard: tuple[int, int] = (2, 2)  # cells in (doppler, range)
    train: tuple[int, int] = (4, 4)
    flip_azimuth: bool = False
    flip_elevation: bool = False
    tolerance_s: float = 0.05  # between a radar frame and its LiDAR scan
    block: int = 32  # frames of a shard
    lidar: LidarSpec = LidarSpec()


class Job(NamedTuple):
    """One shard to write."""

    source: Source
    matches: Matches
    path: str
    about: dict[str, Any]


def prepare(
    path: Path | str,
    folder: Path | str,
    spec: PrepareSpec = PrepareSpec(),
    *,
    frames: slice = slice(None),
    workers: int = 2,
    scheduler: str | None = None,
    keep_going: bool = False,
    **opening: Any,
) -> dict[str, Any]:
    """Prepare all recordings at `path` into `folder`; returns the manifest.

    `frames` are taken of each sequence; `opening` goes to `open_recording`. With
    `keep_going`, frames that cannot be read are dropped and counted; otherwise the
    first raises its ValueError. So does a folder that was prepared with other options,
    and a sequence that loses more than half of its frames.
    """
    folder = Path(folder).absolute()
    sources = find_sources(path, **opening)
    with lock_folder(folder):
        head = _head(sources, spec, frames)
        _check_options(folder, head)
        for scratch in folder.glob("*/.*-*"):  # of a killed run: the folder is ours
            shutil.rmtree(scratch)
        write_text(folder / "manifest.json", json.dumps(head, indent=1) + "\n")
        jobs = [job for s in sources for job in _jobs(s, folder, spec, frames)]
        descriptions = {}
        total = sum(len(job.matches.radar) for job in jobs)
        done = 0
        with progress("preparing", total, unit="frames") as show:
            for job, description in _run(jobs, spec, keep_going, workers, scheduler):
                descriptions[job.path] = description
                done += len(job.matches.radar)
                show(done, job.source.name)
        manifest = head | {
            "complete": True,
            "sequences": [
                _summary(source, jobs, descriptions, spec, frames) for source in sources
            ],
        }
        write_text(folder / "manifest.json", json.dumps(manifest, indent=1) + "\n")
    return manifest


def prepare_frame(
    recording: Recording, radar_index: int, lidar_index: int, spec: PrepareSpec
) -> tuple[PreparedFrame, LidarSteps]:
    """One radar frame with its LiDAR scan, and the steps on the way; on the host."""
    assert recording.lidar is not None
    stamp, lidar_stamp = (
        float(stream.stamps[i])
        for stream, i in (
            (recording.cubes, radar_index),
            (recording.lidar, lidar_index),
        )
    )
    cube = calibrated_cube(recording, radar_index)
    cells, cloud, trusted = radar_side(
        cube, recording.coupling, recording.radar, spec, recording.range_bias_m
    )
    world_from_radar, world_from_lidar = sensor_poses(recording, stamp, lidar_stamp)
    trusted_xyz = np.asarray(trusted.xyz)[np.asarray(trusted.valid)]
    steps = preprocess(
        recording.lidar[lidar_index][:, :3],
        trusted_xyz,
        radar_from_lidar=np.linalg.inv(world_from_radar) @ world_from_lidar,
        spec=spec.lidar,
    )
    known = recording.poses is not None
    frame = PreparedFrame(
        sequence=recording.name,
        frame=radar_index,
        stamp=stamp,
        lidar_stamp=lidar_stamp,
        world_from_radar=world_from_radar if known else np.full((4, 4), np.nan),
        cells=jax.tree.map(np.asarray, cells),
        radar=jax.tree.map(np.asarray, cloud),
        lidar_xyz=steps.xyz[steps.visible],
    )
    return frame, steps


def sensor_poses(
    recording: Recording, stamp: float, lidar_stamp: float
) -> tuple[np.ndarray, np.ndarray]:
    """World from radar and world from LiDAR, each at its own time, on the host.

    Without a trajectory the rig stands still, and the world is its base.
    """
    base = np.stack([np.eye(4)] * 2)
    if recording.poses is not None:
        base = interpolate_poses(recording.poses, np.array([stamp, lidar_stamp]))
        if not np.isfinite(base[1]).all():  # a scan just beyond the trajectory's end
            base[1] = base[0]
    mounted = [
        np.eye(4) if matrix is None else matrix
        for matrix in (recording.base_from_radar, recording.base_from_lidar)
    ]
    return base[0] @ mounted[0], base[1] @ mounted[1]


@functools.partial(jax.jit, static_argnames=("radar", "spec", "range_bias_m"))
def radar_side(
    cube, coupling, radar: RadarSpec, spec: PrepareSpec, range_bias_m: float
) -> tuple[Cells, PointCloud, PointCloud]:
    """Cells of a cube, the condition's cloud and that of the visibility filter."""
    guard, train = largest_window(radar.cube_shape, spec.guard, spec.train)
    cells = all_cells(
        cube,
        radar,
        coupling=coupling,
        flip_azimuth=spec.flip_azimuth,
        flip_elevation=spec.flip_elevation,
    )

    def points(rate):
        mask = DETECTORS[spec.detector](
            cells.power,
            false_alarm_rate=rate,
            channels=radar.num_virtual,
            guard=guard,
            train=train,
        )
        return cell_points(
            cells,
            mask,
            radar,
            capacity=spec.capacity,
            guard=guard,
            train=train,
            range_bias_m=range_bias_m,
        )

    return (
        cells,
        points(spec.false_alarm_rate),
        points(spec.visible_false_alarm_rate),
    )


def matches_of(recording: Recording, spec: PrepareSpec) -> Matches:
    """The recording's matched frames; ValueError where it has no LiDAR or no times."""
    lidar, cubes = recording.lidar, recording.cubes
    if lidar is None or lidar.stamps is None or cubes.stamps is None:
        lacks = "no LiDAR" if lidar is None else "no time stamps"
        raise ValueError(
            f"{recording.path} has {lacks}: training pairs need both sensors and their "
            "times; describe the recording in a capture.toml"
        )
    span = (-np.inf, np.inf)
    if (poses := recording.poses) is not None:
        span = (float(poses.stamps[0]), float(poses.stamps[-1]))
    return match_nearest(
        cubes.stamps, lidar.stamps, tolerance_s=spec.tolerance_s, span=span
    )


def prepare_block(job: Job, spec: PrepareSpec, keep_going: bool) -> dict[str, Any]:
    """Write the shard of a job, unless it stands; returns its description."""
    path = Path(job.path)
    if (found := finished_shard(path, job.about)) is not None:
        return found
    recording = _opened(job.source)
    failed: dict[str, str] = {}

    def frames() -> Iterator[PreparedFrame]:
        for i, j in zip(job.matches.radar, job.matches.lidar, strict=True):
            try:
                frame, _ = prepare_frame(recording, int(i), int(j), spec)
            except ValueError as error:
                if not keep_going:
                    raise
                failed[str(i)] = str(error)
                continue
            yield frame

    return write_shard(path, frames(), job.about, failed)


@functools.lru_cache(maxsize=4)
def _opened(source: Source) -> Recording:
    """A source, opened once in each process."""
    return source.open()


def _head(sources, spec, frames):
    """The manifest before any frame: what decides the shards' bytes."""
    radars = {source.open().radar for source in sources}
    if len(radars) > 1:
        names = sorted(f"{radar.name} {radar.cube_shape}" for radar in radars)
        raise ValueError(
            f"the sequences were recorded with {len(radars)} radars ({', '.join(names)}"
            "), expected one: prepare them apart"
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
    """Refuse a folder that was prepared with other options or from other sources."""
    if not (folder / "manifest.json").exists():
        if any(entry.name != ".lock" for entry in folder.iterdir()):
            raise ValueError(
                f"{folder} is neither empty nor a preparation: choose another -o"
            )
        return
    found, wanted = read_json(folder / "manifest.json"), json.loads(json.dumps(head))
    for key in ("radar", "options", "frames", "names"):
        if found.get(key) != wanted[key]:
            raise ValueError(
                f"{folder} was prepared with other {key}: "
                f"{_difference(found, wanted, key)}; choose another -o"
            )


def _difference(found, wanted, key):
    """The first field that differs, as text."""
    old, new = found.get(key), wanted[key]
    if isinstance(old, dict) and isinstance(new, dict):
        field = next(k for k in {**old, **new} if old.get(k) != new.get(k))
        return f"{field} was {old.get(field)}, now {new.get(field)}"
    return f"{old}, now {new}"


def _jobs(source, folder, spec, frames):
    """The shards of a source: blocks of its matched frames."""
    recording = _opened(source)
    matches = _chosen(recording, spec, frames)
    digest = hashlib.sha256(
        json.dumps(dataclasses.asdict(spec), sort_keys=True).encode()
    ).hexdigest()
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
    """Matches of the frames that were asked for; too many dropped is an error."""
    matches = matches_of(recording, spec)
    wanted = range(*frames.indices(len(recording.cubes)))
    dropped = {i: why for i, why in matches.dropped.items() if i in wanted}
    check_dropped(recording.name, len(wanted), dropped)
    keep = np.isin(matches.radar, wanted)
    return Matches(matches.radar[keep], matches.lidar[keep], dropped)


def _summary(source, jobs, descriptions, spec, frames):
    """A sequence's entry in the manifest; too many dropped or failed is an error."""
    recording = _opened(source)
    shards = [descriptions[job.path] for job in jobs if job.source == source]
    dropped = dict(_chosen(recording, spec, frames).dropped)
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
    """Jobs with their descriptions, as they are finished."""
    if scheduler is None and workers == 1:
        for job in jobs:
            yield job, prepare_block(job, spec, keep_going)
        return
    with _cluster(workers, scheduler) as client:
        from distributed import as_completed

        futures = {
            client.submit(prepare_block, job, spec, keep_going, pure=False): job
            for job in jobs
        }
        for future in as_completed(futures):
            yield futures[future], future.result()


@contextlib.contextmanager
def _cluster(workers, scheduler):
    """A client of the scheduler, or of a cluster of processes on this machine."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise ImportError(
            "more than one worker needs: pip install 'jradar[data]'"
        ) from error
    if scheduler is not None:
        with Client(scheduler, timeout=10) as client:
            yield client
        return
    # Read from files by workers that share the machine: no dashboard, local sockets.
    local = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        dashboard_address=None,
        host="127.0.0.1",
        local_directory=os.environ.get("TMPDIR", "/tmp"),
    )
    with local, Client(local) as client:
        yield client
