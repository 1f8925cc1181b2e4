"""The options of radar points: how cells are detected, located and searched."""

import dataclasses
import math
from typing import Any

from jradar.radar.detect.cfar import DETECTORS
from jradar.radar.detect.cfar_window import (
    EDGES,
    GUARD,
    TRAIN,
    cell_pair,
    check_edge,
    largest_window,
)
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import WINDOWS

ANGLES = ("fft", "music", "capon")
LARGEST = {
    "capacity": 1 << 20,
    "peaks": 64,
    "num_azimuth": 4096,
    "num_elevation": 4096,
}
MOST_FOLDS = 16
MOST_SOURCES = 64


@dataclasses.dataclass(frozen=True)
class PointSpec:
    """How radar points are detected and located.

    `guard` and `train` are the cells of the CFAR window in (doppler, range). `peaks` is
    the number of targets that one cell may hold: each becomes a point, with power and
    SNR in proportion to its peak among the cell's `spectrum_peaks`, or with "capon" and
    "music" among its `subspace_peaks`, which resolve targets within a beam.
    `num_azimuth` None is what the array needs: 64 bins, or more if it is wider.
    `refine` places range, velocity and angles between bins. The windows are those of
    `range_doppler`; the CFAR multipliers account for the correlation that they cause.
    `edge` and `factor` are those of `cfar`; a factor replaces the rate. `remove_static`
    and `remove_interference` are those of `range_doppler`, too. `angles` is "fft", or
    "music" or "capon" for azimuths by `music_directions` or `capon_directions`, which
    use their own bins.
    `sources` is the number of sources for "music", or 0 to count them in each cell.

    `group_peaks` keeps only detected cells that are `map_peaks`: one for each target.
    With `folds`, velocities up to `2 folds + 1` times the unambiguous one are told
    apart by `velocity_folds`, and the cloud has fold and margin. `focus` finds
    directions by `focused_directions`, for arrays as wide as a cascade's.
    """

    detector: str = "os"
    false_alarm_rate: float = 1e-3
    guard: tuple[int, int] = GUARD
    train: tuple[int, int] = TRAIN
    capacity: int = 1024  # points of the cloud, padding included
    peaks: int = 1
    num_azimuth: int | None = None
    num_elevation: int = 32
    refine: bool = True
    remove_static: bool = False
    remove_interference: bool = False
    angles: str = "fft"
    range_window: str = "hann"
    doppler_window: str = "hann"
    edge: str = "shrink"
    factor: float | None = None
    group_peaks: bool = False
    folds: int = 0
    sources: int = 2
    focus: bool = False

    def __post_init__(self):
        """Refuse values that no radar could use, naming the field."""
        for field in ("guard", "train"):
            object.__setattr__(self, field, cell_pair(field, getattr(self, field)))
        for field, choices in (
            ("detector", tuple(DETECTORS)),
            ("angles", ANGLES),
            ("range_window", tuple(WINDOWS)),
            ("doppler_window", tuple(WINDOWS)),
            ("edge", EDGES),
        ):
            if (value := getattr(self, field)) not in choices:
                raise ValueError(f"{field} = {value!r}, expected one of {choices}")
        if not 0 < self.false_alarm_rate <= 1:
            rate = self.false_alarm_rate
            raise ValueError(f"false_alarm_rate = {rate}, expected 0 < rate <= 1")
        if self.factor is not None and not 0 < self.factor < math.inf:
            raise ValueError(f"factor = {self.factor}, expected more than 0 and finite")
        check_edge(self.edge, self.detector, self.train)
        for field, most in LARGEST.items():
            value = getattr(self, field)
            if value is not None and not 1 <= value <= most:
                raise ValueError(f"{field} = {value:,}, expected 1 to {most:,}")
        for field in ("guard", "train"):
            if min(value := getattr(self, field)) < 0:
                raise ValueError(f"{field} = {value}, expected 0 or more cells")
        if not 0 <= self.folds <= MOST_FOLDS:
            raise ValueError(f"folds = {self.folds}, expected 0 to {MOST_FOLDS}")
        if not 0 <= self.sources <= MOST_SOURCES:
            raise ValueError(f"sources = {self.sources}, expected 0 to {MOST_SOURCES}")
        if self.focus and (self.angles != "fft" or self.peaks > 1):
            raise ValueError(
                f"focus = True with angles = {self.angles!r}, peaks = {self.peaks}, "
                "expected 'fft' and 1: a focus has one direction"
            )

    def fitted(self, radar: RadarSpec) -> "PointSpec":
        """Return the spec with CFAR window, azimuth bins and capacity for the radar.

        A frame has no more points than it has cells, times `peaks`.
        """
        cells = radar.num_chirps, radar.num_range_bins
        guard, train = largest_window(cells, self.guard, self.train)
        return dataclasses.replace(
            self,
            guard=guard,
            train=train,
            capacity=min(self.capacity, math.prod(cells) * self.peaks),
        )

    def subtracting(self, coupling: Any) -> "PointSpec":
        """Return the spec with the range window in which `coupling` is subtracted.

        That is "blackman". Without a coupling, and with `remove_static`, which removes
        it too, the spec stays as it is.
        """
        if coupling is None or self.remove_static:
            return self
        return dataclasses.replace(self, range_window="blackman")


POINTS = PointSpec()
