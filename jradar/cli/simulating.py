"""`jradar simulate`: the size of what will be written, and writing it with progress."""

import argparse
import functools
import itertools
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jradar.errors import UsageError
from jradar.progress import progress
from jradar.simulation import (
    frame_bytes,
    set_sequences,
    simulate_capture,
    simulate_sequence,
    simulate_set,
)
from jradar.simulation.sets import FRAMES

SCENE_FRAMES = 50
TRIAL_FRAMES = 4  # simulated by a dry run to estimate the time


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Simulate the scene or set that the options name; return its size and time.

    Raises UsageError for options that exclude each other.
    """
    if options.format == "capture" and (options.set or options.sensor != "single_chip"):
        raise UsageError("--format capture needs --scene and --sensor single_chip")
    count = len(set_sequences(options.set)) if options.set else 1
    each = options.frames or (FRAMES if options.set else SCENE_FRAMES)
    frames = count * each
    size = frames * frame_bytes(sensor=options.sensor, layout=options.format)
    plan = {
        "output": str(options.output),
        "recordings": count,
        "frames per recording": each,
        "size": f"{size / 1e6:,.0f} MB",
    }
    if options.dry_run:
        seconds = frames * _seconds_per_frame(options)
        about = f"about {seconds:,.0f} s on this machine"
        return {**plan, "time": about, "written": "nothing (dry run)"}
    _check_space(options.output, size)
    started = time.perf_counter()
    done = itertools.count(1)
    with progress("simulating", frames, unit="frames") as show:
        job = _job(options, options.output)
        path = job(frames=each, advance=lambda: show(next(done)))
    took = time.perf_counter() - started
    return {**plan, "time": f"{took:.1f} s", "written": str(path)}


def _check_space(output: Path | str, size: float) -> None:
    """Raise OSError if the disk that holds `output` has not `size` bytes left."""
    folder = Path(output).resolve()
    while not folder.exists():
        folder = folder.parent
    if (free := shutil.disk_usage(folder).free) < size:
        raise OSError(
            f"{output} would hold {size / 1e6:,.0f} MB, but its disk has "
            f"{free / 1e6:,.0f} MB left: simulate fewer frames, or choose another disk"
        )


def _job(options: argparse.Namespace, folder: Path | str) -> Callable[..., Path]:
    """Return the function that writes to `folder`; it takes `frames` and `advance`."""
    if options.set:
        return functools.partial(
            simulate_set, options.set, folder, sensor=options.sensor
        )
    scene = (options.scene or "hallways", options.seed, folder)
    if options.format == "capture":
        return functools.partial(simulate_capture, *scene)
    return functools.partial(simulate_sequence, *scene, sensor=options.sensor)


def _seconds_per_frame(options: argparse.Namespace) -> float:
    """Return the time of a frame, measured on a few frames that are then deleted."""
    ticks: list[float] = []
    one_scene = argparse.Namespace(**{**vars(options), "set": None})
    with tempfile.TemporaryDirectory() as folder:
        job = _job(one_scene, folder)
        job(frames=TRIAL_FRAMES, advance=lambda: ticks.append(time.perf_counter()))
    return (ticks[-1] - ticks[1]) / (len(ticks) - 2) if len(ticks) > 2 else 0.0
