"""Texts that say why a radar may not suit a model trained on others; without JAX."""

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Int

from jradar.errors import UsageError
from jradar.options.sensor import RadarSpec

TOLERANCE = 0.05  # relative difference up to which two radars count as alike
MAX_RANGE_M = 10.8  # of polar images
NUM_ANTENNAS = 8  # of the row that makes them; the first are used if there are more
FLAT = (
    "this radar has one row of antennas and measures no elevation: heights in the "
    "result are invented by the model"
)
NARROW = (
    "this radar has one column of antennas and measures no azimuth: directions in the "
    "result are invented by the model"
)
Described = Callable[[RadarSpec], dict[str, float]]


def unsuited(
    kind: str, trained: Sequence[RadarSpec], radar: RadarSpec
) -> Iterator[str]:
    """Yield why a model of this kind, trained on some radars, may not suit another."""
    blind, described = KINDS[kind]
    if without := blind(radar):
        yield without
    yield from differences(trained, radar, described)


def differences(
    trained: Sequence[RadarSpec], radar: RadarSpec, described: Described
) -> Iterator[str]:
    """Yield what differs from the radars of training, if anything does.

    `described` returns the properties that matter, each by its text with a place for
    its number.
    """
    known = [described(seen) for seen in trained]
    differ = []
    for name, value in described(radar).items() if known else ():
        values = [waveform[name] for waveform in known]
        low, high = min(values), max(values)
        if not low * (1 - TOLERANCE) <= value <= high * (1 + TOLERANCE):
            span = dict.fromkeys((f"{low:.3g}", f"{high:.3g}"))
            differ.append(f"{name.format(value)} here, {' to '.join(span)} in training")
    if differ:
        yield (
            f"the model was trained on other radars ({trained[0].name}), so expect "
            f"worse clouds: {'; '.join(differ)}"
        )


def blind(radar: RadarSpec) -> str:
    """Return a text about the angle that the radar lacks; "" if it measures both."""
    if not radar.has_elevation:
        return FLAT
    return "" if radar.has_azimuth else NARROW


def waveform(radar: RadarSpec) -> dict[str, float]:
    """Return the properties of a radar that shape its points."""
    return {
        "range to {:.3g} m": radar.max_range_m,
        "range bins of {:.3g} m": radar.range_resolution_m,
        "velocity to {:.3g} m/s": radar.max_velocity_mps,
        "carrier at {:.3g} GHz": radar.center_frequency_hz / 1e9,
        "{:.0f} virtual antennas": float(radar.num_virtual),
    }


def without_row(radar: RadarSpec) -> str:
    """Return a text that a radar has no row of antennas; "" if it has one."""
    try:
        azimuth_row(radar)
    except UsageError as error:
        return str(error)
    return ""


def plane(radar: RadarSpec) -> dict[str, float]:
    """Return the properties of a radar that shape its polar images."""
    row = [] if without_row(radar) else azimuth_row(radar)[0]
    return {
        "range to {:.3g} m": min(radar.max_range_m, MAX_RANGE_M),
        "range bins of {:.3g} m": radar.range_resolution_m,
        "{:.0f} antennas in a row": float(len(row)),
    }


@functools.cache
def azimuth_row(
    radar: RadarSpec,
) -> tuple[Int[np.ndarray, " antenna"], Int[np.ndarray, " antenna"]]:
    """Return the virtual antennas of the longest gapless row, and their columns.

    If several rows have the same length, the lowest is taken. Of a row that is longer
    than NUM_ANTENNAS, the first antennas are taken.
    """
    places = radar.virtual_positions.tolist()
    best: list[int] = []
    for row in sorted({row for _, row in places}):
        antennas = {places[i][0]: i for i in range(len(places)) if places[i][1] == row}
        for start in sorted(antennas):
            run = itertools.takewhile(antennas.__contains__, itertools.count(start))
            found = [antennas[column] for column in run]
            best = max(best, found, key=len)  # the first of equals
    if len(best) < 2:
        raise UsageError(
            f"{radar.name} has no two antennas next to each other in a row, expected 2 "
            f"to {NUM_ANTENNAS}: a polar image needs azimuths"
        )
    best = best[:NUM_ANTENNAS]
    return np.array(best), radar.virtual_positions[best, 0]


# By kind of model: the text on what a radar lacks, and the properties that matter.
KINDS: dict[str, tuple[Callable[[RadarSpec], str], Described]] = {
    "view": (blind, waveform),
    "polar": (without_row, plane),
}
