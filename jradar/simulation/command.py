"""What `jradar simulate` does: plan, say what it costs, write and say how far it is."""

import functools
import itertools
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jradar.progress import progress
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.scanner import MID360_POINTS, OUSTER_COLUMNS, OUSTER_ROWS
from jradar.simulation.sequence import CLOCKS, RADARS, SENSORS, simulate_sequence
from jradar.simulation.sets import FRAMES, set_sequences, simulate_set

FORMATS = ("coloradar", "capture")
LIVOX_POINT_BYTES = 19
TRIAL_FRAMES = 4  # that a dry run times


def simulate(options: Any) -> dict[str, Any]:
    """Run the command with argparse's `options`; returns what is printed.

    They are scene, set, frames, seed, output, sensor, format, dry_run and json. Raises
    ValueError for options that do not go together.
    """
    if (options.scene is None) == (options.set is None):
        raise ValueError("expected either --scene FAMILY or --set NAME")
    if options.format == "capture" and (options.set or options.sensor != "single_chip"):
        raise ValueError("--format capture is for --scene with --sensor single_chip")
    frames = options.frames or (FRAMES if options.set else 50)
    count = len(set_sequences(options.set)) if options.set else 1
    size = count * frames * frame_bytes(options.sensor, options.format)
    plan = {
        "output": str(options.output),
        "sequences": count,
        "frames of each": frames,
        "size": f"{size / 1e6:,.0f} MB",
    }
    if options.dry_run:
        family = options.scene or "hallways"
        per_frame_s = _trial(family, options)
        about = f"about {count * frames * per_frame_s:,.0f} s on this machine"
        return {**plan, "time": about, "written": "nothing: this is a dry run"}
    job = _job(options, frames)
    started = time.perf_counter()
    path = _with_progress(job, count * frames)
    took = time.perf_counter() - started
    return {**plan, "time": f"{took:.1f} s", "written": str(path)}


def frame_bytes(sensor: str, layout: str) -> float:
    """Bytes on disk for each frame of the first radar, without poses and IMU."""
    first = SENSORS[sensor][0]
    total = 0.0
    for name in SENSORS[sensor]:
        tx, rx, chirps, samples = RADARS[name]().cube_shape
        rate = CLOCKS[name].rate_hz / CLOCKS[first].rate_hz
        total += rate * 4 * tx * rx * chirps * samples
    scan = 16 * OUSTER_ROWS * OUSTER_COLUMNS
    if layout == "capture":
        scan = LIVOX_POINT_BYTES * MID360_POINTS
    return total + scan * CLOCKS["lidar"].rate_hz / CLOCKS[first].rate_hz


def _job(options: Any, frames: int) -> Callable[..., Path]:
    """The call that writes, which takes `advance`."""
    if options.set:
        return functools.partial(
            simulate_set,
            options.set,
            options.output,
            frames=frames,
            sensor=options.sensor,
        )
    scene = (options.scene, options.seed, options.output)
    if options.format == "capture":
        return functools.partial(simulate_capture, *scene, frames=frames)
    return functools.partial(
        simulate_sequence, *scene, frames=frames, sensor=options.sensor
    )


def _with_progress(job: Callable[..., Path], frames: int) -> Path:
    """Run the job, saying how far it is on stderr."""
    done = itertools.count(1)
    with progress("simulating", frames, unit="frames") as show:
        return job(advance=lambda: show(next(done)))


def _trial(family: str, options: Any) -> float:
    """Seconds of a frame, by making a few and throwing them away."""
    ticks: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        trial = {
            "frames": TRIAL_FRAMES,
            "advance": lambda: ticks.append(time.perf_counter()),
        }
        if options.format == "capture":
            simulate_capture(family, options.seed, folder, **trial)
        else:
            simulate_sequence(
                family, options.seed, folder, sensor=options.sensor, **trial
            )
    return (ticks[-1] - ticks[1]) / (len(ticks) - 2) if len(ticks) > 2 else 0.0
