"""The options of radar points: how cells are detected, located and searched."""

import dataclasses
import math
from typing import Any

from jradar.radar.detect.cfar_window import Window, check_window, largest_window
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import WINDOWS

ANGLES = ("fft", "music", "capon")
LIMITS = {
    "capacity": (1, 1 << 20),
    "peaks": (1, 64),
    "num_azimuth": (1, 4096),
    "num_elevation": (1, 4096),
    "folds": (0, 16),
    "sources": (1, 64),
}


@dataclasses.dataclass(frozen=True)
class PointSpec:
    """How radar points are detected and located.

    Every field is an option of `jradar points` too, whose help is the line below it.
    """

    detector: str = "os"
    """CFAR detector: ca (cell averaging), go (greatest of), so (smallest of) or os
    (ordered statistic)"""
    false_alarm_rate: float = 1e-3
    """probability that a cell of pure noise is detected"""
    guard: tuple[int, int] = (2, 2)
    """cells around the tested one, in Doppler and in range, that may hold its own
    signal and do not count as noise"""
    train: tuple[int, int] = (4, 4)
    """cells beyond the guard cells that measure the noise"""
    capacity: int = 1024
    """largest number of points; the strongest are kept"""
    peaks: int = 1
    """targets that one cell may hold: each becomes a point, with power and SNR in
    proportion to its peak in the angle spectrum"""
    num_azimuth: int | None = None
    """azimuth bins of the angle spectrum; by default 64, or more for a wider array"""
    num_elevation: int = 32
    """elevation bins of the angle spectrum"""
    refine: bool = True
    """place range, velocity and angles between bins"""
    remove_static: bool = False
    """keep only echoes that move"""
    remove_interference: bool = False
    """excise crossing chirps of other radars from the samples"""
    angles: str = "fft"
    """fft (beamforming), or music or capon for azimuths finer than a beam, which use
    their own bins"""
    range_window: str = "hann"
    """window over the samples of a chirp: none, hann, hamming or blackman"""
    doppler_window: str = "hann"
    """window over the chirps of a frame: none, hann, hamming or blackman"""
    edge: str = "shrink"
    """CFAR at the ends of the range axis: shrink, one_sided, fill, reflect, wrap or
    skip"""
    factor: float | None = None
    """threshold over the noise in place of the false-alarm rate"""
    group_peaks: bool = False
    """keep one cell of each target: the peaks of the map"""
    folds: int = 0
    """also resolve velocities up to 2 N + 1 times the unambiguous one"""
    sources: int = 2
    """targets in a beam for music"""
    focus: bool = False
    """focus wide arrays, such as a cascade's, on each target: delays, near field"""

    def __post_init__(self):
        check_window(Window(self.guard, self.train, self.edge), self.detector)
        for field in ("guard", "train"):
            object.__setattr__(self, field, tuple(getattr(self, field)))
        for field, choices in (
            ("angles", ANGLES),
            ("range_window", tuple(WINDOWS)),
            ("doppler_window", tuple(WINDOWS)),
        ):
            if (value := getattr(self, field)) not in choices:
                raise ValueError(f"{field} = {value!r}, expected one of {choices}")
        if not 0 < self.false_alarm_rate <= 1:
            rate = self.false_alarm_rate
            raise ValueError(f"false_alarm_rate = {rate}, expected 0 < rate <= 1")
        if self.factor is not None and not 0 < self.factor < math.inf:
            raise ValueError(f"factor = {self.factor}, expected more than 0 and finite")
        for field, (least, most) in LIMITS.items():
            value = getattr(self, field)
            if value is not None and not least <= value <= most:
                raise ValueError(f"{field} = {value:,}, expected {least} to {most:,}")
        if self.focus and (self.angles != "fft" or self.peaks > 1):
            raise ValueError(
                f"focus = True with angles = {self.angles!r}, peaks = {self.peaks}, "
                "expected 'fft' and 1: a focus has one direction"
            )

    def fitted(self, radar: RadarSpec) -> "PointSpec":
        """Return the spec with a CFAR window and a capacity that suit the radar.

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
