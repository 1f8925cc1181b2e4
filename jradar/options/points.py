"""The options of radar points: how cells are detected, located and searched."""

import dataclasses
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from jradar.fields import option
from jradar.options.detectors import (
    EDGES,
    GUARD,
    KINDS,
    TRAIN,
    Window,
    check_window,
    largest_window,
)

if TYPE_CHECKING:
    from jradar.options.sensor import RadarSpec

ANGLES = ("fft", "music", "capon")
WINDOWS = {  # coefficients of the cosine series, periodic
    "none": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
LIMITS = {
    "capacity": (1, 1 << 20),
    "peaks": (1, 64),
    "num_azimuth": (1, 4096),
    "num_elevation": (1, 4096),
    "folds": (0, 16),
    "sources": (1, 64),
}


def names(choices: Iterable[str]) -> str:
    """Write choices as "a, b or c"."""
    *first, last = choices
    return f"{', '.join(first)} or {last}"


@dataclasses.dataclass(frozen=True)
class PointSpec:
    """How radar points are detected and located.

    Every field is an option of `jradar points`, too, with the same help.
    """

    detector: str = option(
        "os", f"CFAR detector: {names(f'{k} ({text})' for k, text in KINDS.items())}"
    )
    false_alarm_rate: float = option(
        1e-3, "probability that a cell of pure noise is detected"
    )
    guard: tuple[int, int] = option(
        GUARD,
        "cells around the tested one, in Doppler and in range, that may hold its own "
        "signal and do not count as noise",
    )
    train: tuple[int, int] = option(
        TRAIN, "cells beyond the guard cells that measure the noise"
    )
    capacity: int = option(1024, "largest number of points; the strongest are kept")
    peaks: int = option(
        1,
        "targets that one cell may hold: each becomes a point, with power and SNR in "
        "proportion to its peak in the angle spectrum",
    )
    num_azimuth: int | None = option(
        None,
        "azimuth bins of the angle spectrum; by default 64, or more for a wider array",
    )
    num_elevation: int = option(32, "elevation bins of the angle spectrum")
    refine: bool = option(True, "place range, velocity and angles between bins")
    remove_static: bool = option(False, "keep only echoes that move")
    remove_interference: bool = option(
        False, "excise crossing chirps of other radars from the samples"
    )
    angles: str = option(
        "fft",
        "fft (beamforming), or music or capon for azimuths finer than a beam, which "
        "use their own bins",
    )
    range_window: str = option(
        "hann", f"window over the samples of a chirp: {names(WINDOWS)}"
    )
    doppler_window: str = option(
        "hann", f"window over the chirps of a frame: {names(WINDOWS)}"
    )
    edge: str = option("shrink", f"CFAR at the ends of the range axis: {names(EDGES)}")
    factor: float | None = option(
        None, "threshold over the noise in place of the false-alarm rate"
    )
    group_peaks: bool = option(
        False, "keep one cell of each target: the peaks of the map"
    )
    folds: int = option(
        0, "also resolve velocities up to 2 N + 1 times the unambiguous one"
    )
    sources: int = option(2, "targets in a beam for music")
    focus: bool = option(
        False,
        "focus wide arrays, such as a cascade's, on each target, with its delays and "
        "near field",
    )

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

    def fitted(self, radar: "RadarSpec") -> "PointSpec":
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
