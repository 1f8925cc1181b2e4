"""A recording: radar frames and what other sensors saw beside them, read when asked.

Readers of every format return a `Recording`; preparation, the command line and the
benchmarks know nothing else. What a recording lacks is None.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from jradar.lidar import Poses
from jradar.radar import FrequencyPhase, RadarSpec


class Stream(Sequence):
    """Items of one sensor in the order of their recording; opening reads none."""

    def __init__(
        self,
        read: Callable[[int], np.ndarray],
        count: int,
        stamps: np.ndarray | None = None,
    ):
        """`read(i)` returns item i of `count`; `stamps` are seconds, float64 [item]."""
        if stamps is not None and len(stamps) != count:
            raise ValueError(f"{len(stamps)} stamps for {count} items")
        self.stamps, self._read, self._count = stamps, read, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int | slice) -> Any:
        """Item `index`, read from its file."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"item {index} of {len(self)}")
        return self._read(index % len(self))


class Recording(NamedTuple):
    """One sequence or capture. All transforms are 4 x 4 matrices in float64."""

    name: str  # of the sequence, as records name it
    path: Path
    radar: RadarSpec
    cubes: Stream  # complex64 [tx, rx, chirp, sample], ADC counts
    lidar: Stream | None = None  # float32 [point, 4]: x y z intensity, LiDAR's frame
    poses: Poses | None = None  # of the base in the world
    base_from_radar: Float[np.ndarray, "4 4"] | None = None
    base_from_lidar: Float[np.ndarray, "4 4"] | None = None
    coupling: Complex[np.ndarray, "tx rx half_range"] | None = None
    frequency_phase: FrequencyPhase | None = None
    channel_factors: Complex[np.ndarray, " virtual"] | None = None  # of a TI .cfg
    range_bias_m: float = 0.0  # of a TI .cfg; to subtract from ranges
    lost_bytes: Int[np.ndarray, " frame"] | None = None  # zero-filled, per frame
    notes: tuple[str, ...] = ()  # what was mended or is doubtful, for people
