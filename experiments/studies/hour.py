r"""How long does the map of an hour take, and how much memory?

    python -m experiments.studies.hour -o runs/hour
    jradar simulate --scene corridor -o sim
    python -m experiments.studies.hour sim/corridor_0 -o runs/hour-samples

A radar is carried around a block of rooms at 1 m/s, ten frames a second, with exact
poses. It sends 100 points a frame of the walls around it. With a RECORDING of samples,
its frames come again and again instead: the map is then of no place, but takes as long
as one. The table has time and memory, `hour.png` the memory as the walk goes on.
"""

import resource
import sys
import time
from argparse import Namespace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.command import run_study, study_parser
from jradar import PointCloud, load_model, open_recording
from jradar.evaluation.tables import markdown_table
from jradar.files import write_text
from jradar.lidar import Poses
from jradar.mapping import map_recording
from jradar.recordings import Recording, Stream
from jradar.viz import save_figure

PERIOD_S, SPEED_MPS = 0.1, 1.0
FRAMES, POINTS = 36_000, 100
CORNERS = np.array([(0.0, 0), (40, 0), (40, 30), (0, 30)])  # of the path, in metres
ASIDE_M = 5.0  # of the walls, on both sides of the path
SEEN_M, NOISE_M = 10.0, 0.04
EVERY = 100  # frames between two readings of the memory
TITLES = "frames", "seconds", "times as fast as recorded", "voxels", "peak (MB)"


def main(argv: list[str] | None = None) -> int:
    """Write a table and a picture, and return the exit code."""
    parser = study_parser("experiments.studies.hour", __doc__)
    parser.add_argument("recording", nargs="?", type=Path, help="one of samples")
    parser.add_argument("--frames", type=int, default=FRAMES)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Map the walk, and write how long it took."""
    walked, begin = walk(options.frames, options.recording), time.perf_counter()
    megabytes = [(0, _memory_mb())]

    def advance(done: int, note: str = "") -> None:
        if done % EVERY == 0 or note:
            megabytes.append((done, _memory_mb()))

    found = map_recording(walked, load_model("jradar-maps"), advance=advance)
    took = time.perf_counter() - begin
    megabytes.append((len(found.path), _memory_mb()))
    faster = len(found.path) * PERIOD_S / took
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    row = len(found.path), f"{took:.0f}", f"{faster:.1f}", len(found.enhanced.voxels)
    text = markdown_table(TITLES, [(*row, f"{peak:.0f}")])
    write_text(options.output / "hour.md", f"{text}\n")
    save_figure(_figure(megabytes), options.output / "hour.png")
    print(text)


def walk(frames: int, recording: Path | None = None) -> Recording:
    """Return a walk with poses: of points, or of the samples of a recording."""
    xy, yaw = path(frames)
    stamps, zero = PERIOD_S * np.arange(frames), np.zeros(frames)
    turns = np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], -1)
    poses = Poses(stamps, np.column_stack([xy, zero]), turns)
    if recording is not None:
        given = open_recording(recording)
        cubes = given.cubes
        again = Stream(lambda k: cubes[k % len(cubes)], frames, stamps)
        middle = poses._replace(stamps=stamps + given.frame_middle_s)
        return given._replace(cubes=again, poses=middle)
    walls = _walls(np.random.default_rng(0))
    points = Stream(lambda k: _seen(k, walls, xy[k], yaw[k]), frames, stamps)
    return Recording("walk", Path("walk"), points=points, poses=poses)


def path(frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places and yaw of the frames of rounds along `CORNERS`."""
    sides = np.roll(CORNERS, -1, axis=0) - CORNERS
    ends = np.cumsum(np.linalg.norm(sides, axis=1))
    along = SPEED_MPS * PERIOD_S * np.arange(frames)
    side = np.searchsorted(ends, along % ends[-1], side="right")
    left = (ends[side] - along % ends[-1]) / np.linalg.norm(sides[side], axis=1)
    xy = CORNERS[side] + sides[side] * (1 - left)[:, None]
    # The last metre of a side turns to the next one.
    share = np.clip(1 - left * np.linalg.norm(sides[side], axis=1), 0, 1)
    return xy, np.pi / 2 * (side + share)


def _walls(rng):
    """Return points of the walls outside the path and of the block inside."""
    found = []
    middle = CORNERS.mean(0)
    for away, count in ((ASIDE_M, 4000), (-ASIDE_M, 2500)):
        corners = CORNERS + away * np.sign(CORNERS - middle)
        for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            xy = begin + rng.uniform(size=(count, 1)) * (end - begin)
            found.append(np.column_stack([xy, rng.uniform(-1, 1.5, count)]))
    return np.concatenate(found)


def _seen(number, walls, xy, yaw):
    """Return the points of a frame, in the radar's frame, with their velocities."""
    rng, (cos, sin) = np.random.default_rng(number), (np.cos(yaw), np.sin(yaw))
    ahead = (walls[:, :2] - xy) @ np.array([[cos, -sin], [sin, cos]])
    near = (ahead[:, 0] > 0.5) & (np.abs(ahead[:, 1]) < 1.7 * ahead[:, 0])
    index = np.flatnonzero(near & (np.linalg.norm(ahead, axis=1) < SEEN_M))
    index = rng.choice(index, min(POINTS, len(index)), replace=False)
    exact = np.column_stack([ahead[index], walls[index, 2]])
    xyz = (exact + NOISE_M * rng.normal(size=exact.shape)).astype(np.float32)
    velocity = -SPEED_MPS * xyz[:, 0] / np.linalg.norm(xyz, axis=1)
    rows = xyz, np.ones(len(xyz), bool)
    return PointCloud(*rows, velocity=velocity)  # pyright: ignore[reportArgumentType]


def _memory_mb() -> float:
    """Return the memory that this process uses now; Linux."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def _figure(megabytes) -> Figure:
    """Draw the memory over the minutes of the walk."""
    frames, used = np.transpose(megabytes)
    figure = Figure((6, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(frames * PERIOD_S / 60, used)
    axes.set(xlabel="walked (minutes)", ylabel="memory (MB)", ylim=(0, None))
    axes.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    sys.exit(main())
