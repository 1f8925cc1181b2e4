"""What a simulation will write, how large it is, and writing it."""

import dataclasses
import itertools
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from jradar.errors import UsageError
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.sequence import frame_bytes, simulate_sequence
from jradar.simulation.sets import FRAMES, set_sequences, simulate_set

SCENE_FRAMES = 50
TRIAL_FRAMES = 4  # simulated to estimate the time


@dataclasses.dataclass(frozen=True)
class SimulationPlan:
    """One recording of a scene, or a whole set.

    Give a `set`, or else a `scene` and its `seed`. `layout` is "coloradar" or
    "capture". Raises UsageError for a set in the layout of a capture.
    """

    scene: str = "hallways"
    seed: int = 0
    set: str | None = None
    frames: int | None = None  # of each recording; None is 50 of a scene, 1 of a set
    sensor: str = "single_chip"
    layout: str = "coloradar"

    def __post_init__(self):
        """Refuse options that exclude each other."""
        if self.layout == "capture" and (self.set or self.sensor != "single_chip"):
            raise UsageError("--format capture needs --scene and --sensor single_chip")

    @property
    def recordings(self) -> int:
        """How many recordings are written."""
        return len(set_sequences(self.set)) if self.set else 1

    @property
    def frames_each(self) -> int:
        """The frames of each recording."""
        return self.frames or (FRAMES if self.set else SCENE_FRAMES)

    @property
    def size(self) -> float:
        """Bytes on disk."""
        each = frame_bytes(sensor=self.sensor, layout=self.layout)
        return self.recordings * self.frames_each * each

    def write(
        self, folder: Path | str, *, advance: Callable[[int], None] = lambda done: None
    ) -> Path:
        """Write the recordings to `folder`; return the path of the scene or the set.

        `advance` is called with the number of frames done. Raises OSError, before
        anything is written, for a disk that is too small.
        """
        _check_space(folder, self.size)
        done, frames = itertools.count(1), self.frames_each

        def tick() -> None:
            advance(next(done))

        if self.set:
            return simulate_set(
                self.set, folder, frames=frames, sensor=self.sensor, advance=tick
            )
        scene = self.scene, self.seed, folder
        if self.layout == "capture":
            return simulate_capture(*scene, frames=frames, advance=tick)
        return simulate_sequence(
            *scene, frames=frames, sensor=self.sensor, advance=tick
        )

    def seconds(self) -> float:
        """Return the expected time, measured on a few frames that are then deleted."""
        ticks: list[float] = []
        trial = dataclasses.replace(self, set=None, frames=TRIAL_FRAMES)
        with tempfile.TemporaryDirectory() as folder:
            trial.write(folder, advance=lambda done: ticks.append(time.perf_counter()))
        if len(ticks) < 3:
            return 0.0
        each = (ticks[-1] - ticks[1]) / (len(ticks) - 2)  # the first one compiles
        return self.recordings * self.frames_each * each


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
