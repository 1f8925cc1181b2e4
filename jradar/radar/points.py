"""Radar cube to point cloud: the paper's section III-A.

There are two ways, which give the same points:

    cube --radar_points--> PointCloud                          detected cells only
    cube --all_cells--> Cells --cell_points(mask)--> PointCloud        every cell

`radar_points` finds the directions of the cells that its CFAR detector marks.
`all_cells` finds the directions of every cell once, so that masks of several detectors,
with a threshold or learned, can be compared. Both take a `PointSpec`.
"""

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from jradar.radar.angle import FLIPS, angle_spectrum, azimuth_bins, spectrum_peaks
from jradar.radar.calibration import compensate_tdm, subtract_coupling
from jradar.radar.cfar import (
    DETECTORS,
    EDGES,
    GUARD,
    TRAIN,
    cell_pair,
    check_edge,
    largest_window,
    noise_floor,
)
from jradar.radar.clusters import map_peaks
from jradar.radar.direction import directions
from jradar.radar.folds import velocity_folds
from jradar.radar.near_field import focused_directions
from jradar.radar.peaks import window_offset
from jradar.radar.samples import (
    FULL_SCALE,
    Cube,
    as_samples,
    non_finite_samples,
    saturated_samples,
)
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import WINDOWS, range_doppler
from jradar.radar.subspace import capon_directions, music_directions
from jradar.types import PointCloud

ANGLES = ("fft", "music", "capon")
LARGEST = {
    "capacity": 1 << 20,
    "peaks": 64,
    "num_azimuth": 4096,
    "num_elevation": 4096,
}
SPECTRUM = ("range_window", "doppler_window", "remove_static", "remove_interference")
MOST_FOLDS = 16
MOST_SOURCES = 64
WRAPPED = 2  # range bins behind bin 0 that a window's main lobe reaches
SPECTRA = 64  # angle spectra that are held in memory at a time

Coupling = Complex[Array, "tx rx half_range"]


@dataclasses.dataclass(frozen=True)
class PointSpec:
    """How radar points are detected and located.

    `guard` and `train` are the cells of the CFAR window in (doppler, range). `peaks` is
    the number of targets that one cell may hold: each becomes a point, with power and
    SNR in proportion to its peak among the cell's `spectrum_peaks`. `num_azimuth` None
    is what the array needs: 64 bins, or more if it is wider. `refine` places range,
    velocity and angles between bins. The windows are those of `range_doppler`; the CFAR
    multipliers account for the correlation that they cause. `edge` and `factor` are
    those of `cfar`; a factor replaces the rate. `remove_static` and
    `remove_interference` are those of `range_doppler`, too. The flips are for a sensor
    that is mounted upside down. `angles` is "fft", or "music" or "capon" for azimuths
    by `music_directions` or `capon_directions`, which use their own bins. `sources` is
    the number of sources for "music", or 0 to count them in each cell.

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
    flip_azimuth: bool = False
    flip_elevation: bool = False
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
        if self.angles != "fft" and self.peaks > 1:
            raise ValueError(
                f"peaks = {self.peaks}, expected 1 with angles = {self.angles!r}: it "
                "finds one direction for each cell"
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


class PointReport(NamedTuple):
    """What a cloud of `radar_points` does not show.

    A sample that is not finite makes the whole spectrum so: the cloud is empty then.
    """

    detected: Int[Array, "*batch"]  # cells that the detector marked, of usable ranges
    dropped: Int[Array, "*batch"]  # of them, the weakest, which exceed the capacity
    saturated: Int[Array, "*batch"]  # samples with a part at full scale
    non_finite: Int[Array, "*batch"]  # samples with a part that is NaN or infinite


class Cells(NamedTuple):
    """Power, summed over antennas, and strongest direction in radians of each cell."""

    power: Float[Array, "*batch doppler range"]
    azimuth: Float[Array, "*batch doppler range"]
    elevation: Float[Array, "*batch doppler range"]


@functools.partial(jax.jit, static_argnames=("radar", "points", "range_bias_m"))
def radar_points(
    cube: Cube,
    radar: RadarSpec,
    *,
    points: PointSpec = PointSpec(),
    coupling: Coupling | None = None,
    range_bias_m: float = 0.0,
) -> PointCloud:
    """Return the strongest detections of one frame, strongest first.

    Positions are those in the middle of the frame, `radar.frame_middle_s` after its
    first chirp. Velocity is in m/s, power in ADC counts squared; the SNR compares the
    power with the mean of the training cells. Elevation is 0 for an array with one row,
    azimuth for one with one column. Bin 0 and the last two range bins, into which a
    window spreads the leakage of the antennas, never become points.

    `coupling` is the leakage for `subtract_coupling`; with it the range window is
    Blackman, the only one that its file fits. `range_bias_m` is subtracted from ranges;
    channels are calibrated beforehand, on the cube. One frame; `vmap` it. Raises
    ValueError for a cube that does not fit. `points_and_report` also counts what is
    missing.
    """
    return _points(cube, radar, points, coupling, range_bias_m)[0]


@functools.partial(
    jax.jit, static_argnames=("radar", "points", "range_bias_m", "full_scale")
)
def points_and_report(
    cube: Cube,
    radar: RadarSpec,
    *,
    points: PointSpec = PointSpec(),
    coupling: Coupling | None = None,
    range_bias_m: float = 0.0,
    full_scale: float = FULL_SCALE,
) -> tuple[PointCloud, PointReport]:
    """Return `radar_points` and counts of what the cloud does not show.

    `full_scale` is the largest number of the converter, in the units of the cube.
    """
    cloud, candidates = _points(cube, radar, points, coupling, range_bias_m)
    detected = (candidates > 0).sum()
    report = PointReport(
        detected=detected,
        dropped=jnp.maximum(detected - points.capacity, 0),
        saturated=saturated_samples(cube, full_scale=full_scale),
        non_finite=non_finite_samples(cube),
    )
    return cloud, report


def _points(cube, radar, points, coupling, range_bias_m):
    """The cloud, and the power of each detected cell, 0 for others."""
    points = points.subtracting(coupling)
    spectrum, power = _spectra(cube, radar, points, coupling)
    mask = detect(power, radar, points=points)
    candidates = _candidates(power, mask, radar, range_bias_m)
    strongest, cell = _strongest_cells(candidates, points)
    range_bin, doppler_bin = _bins(power, cell, points)
    snapshot = spectrum.reshape(radar.num_virtual, -1)[:, cell].T
    folds = None
    if points.folds:
        bins = _angle_bins(points, radar)
        folds = velocity_folds(snapshot, doppler_bin, radar, most=points.folds, **bins)
        doppler_bin += folds.fold * radar.num_chirps
    snapshot = compensate_tdm(snapshot, doppler_bin, radar)
    place = radar, points, range_bias_m
    if points.focus:
        direction = _focused(spectrum, cell, range_bin, doppler_bin, *place)
    elif points.peaks == 1:
        direction = _directions(snapshot, radar, points)
    else:
        strongest, direction, of = _strongest_peaks(strongest, snapshot, radar, points)
        cell = cell[of]
        folds = jax.tree.map(lambda values: values[of], folds)
    cloud = _cloud(power, cell, strongest, direction, *place)
    return cloud if folds is None else _unfolded(cloud, folds, radar), candidates


@functools.partial(jax.jit, static_argnames=("radar", "points"))
def all_cells(
    cube: Cube,
    radar: RadarSpec,
    *,
    points: PointSpec = PointSpec(),
    coupling: Coupling | None = None,
) -> Cells:
    """Return the power and direction of every cell of one frame; `vmap` it.

    With `coupling`, give `detect` and `cell_points` the spec `points.subtracting`.
    `points.peaks` and the options of detection are not used. Raises ValueError for a
    cube that does not fit the radar, and for `folds` and `focus`.
    """
    if points.folds or points.focus:
        raise ValueError(
            f"folds = {points.folds}, focus = {points.focus}, expected 0 and False: "
            "cells have no folds and no focus, use radar_points"
        )
    points = points.subtracting(coupling)
    spectrum, power = _spectra(cube, radar, points, coupling)
    _, doppler_bin = _bins(power, jnp.arange(power.size), points)
    snapshot = spectrum.reshape(radar.num_virtual, -1).T
    snapshot = compensate_tdm(snapshot, doppler_bin, radar)
    azimuth, elevation = _directions(snapshot, radar, points)
    return Cells(power, azimuth.reshape(power.shape), elevation.reshape(power.shape))


@functools.partial(jax.jit, static_argnames=("radar", "points", "range_bias_m"))
def cell_points(
    cells: Cells,
    mask: Bool[Array, "doppler range"],
    radar: RadarSpec,
    *,
    points: PointSpec = PointSpec(),
    range_bias_m: float = 0.0,
) -> PointCloud:
    """Return the points of the cells in `mask`, strongest first; one frame, `vmap` it.

    With the mask of `detect`, these are the points of `radar_points`.
    """
    power, azimuth, elevation = cells
    expected = radar.num_chirps, radar.num_range_bins
    for name, values in (*cells._asdict().items(), ("mask", mask)):
        if values.shape != expected:
            raise ValueError(
                f"{name} has shape {values.shape}, {radar.name} needs [doppler, range] "
                f"= {expected}: one frame, or another radar?"
            )
    candidates = _candidates(power, mask, radar, range_bias_m)
    strongest, cell = _strongest_cells(candidates, points)
    direction = azimuth.ravel()[cell], elevation.ravel()[cell]
    return _cloud(power, cell, strongest, direction, radar, points, range_bias_m)


@functools.partial(jax.jit, static_argnames=("radar", "points"))
def detect(
    power: Float[Array, "*batch doppler range"], radar: RadarSpec, *, points: PointSpec
) -> Bool[Array, "*batch doppler range"]:
    """Return the cells that the CFAR detector of `points` marks in the summed power.

    With `group_peaks`, only the peaks among them.

    Raises ValueError where the window does not fit into the map.
    """
    mask = DETECTORS[points.detector](
        power,
        false_alarm_rate=points.false_alarm_rate if points.factor is None else None,
        factor=points.factor,
        edge=points.edge,
        channels=radar.num_virtual,
        guard=points.guard,
        train=points.train,
        windows=(points.doppler_window, points.range_window),
    )
    return mask & map_peaks(power) if points.group_peaks else mask


def _unfolded(cloud, folds, radar):
    """The cloud with the velocities of its points' folds."""
    fold = jnp.where(cloud.valid, folds.fold, 0)
    return cloud._replace(
        velocity=cloud.velocity + fold * (2 * radar.max_velocity_mps),
        fold=fold,
        fold_margin_db=jnp.where(cloud.valid, folds.margin_db, 0.0),
    )


def _spectra(cube, radar, points, coupling):
    """`range_doppler` of the cube without its coupling.

    `remove_static` removes the coupling too, because it is steady.
    """
    cube = as_samples(cube)
    if cube.shape != radar.cube_shape:
        raise ValueError(
            f"cube has shape {cube.shape}, {radar.name} needs [tx, rx, chirp, sample] "
            f"= {radar.cube_shape}: one frame, or another radar?"
        )
    if jnp.iscomplexobj(cube) == radar.real_samples:
        expected = "real" if radar.real_samples else "complex"
        raise ValueError(
            f"the samples are {cube.dtype}, {radar.name} delivers {expected} ones"
        )
    spectrum, power = range_doppler(cube, **_fields(points, SPECTRUM))
    if coupling is None or points.remove_static:
        return spectrum, power
    window = points.doppler_window
    spectrum = subtract_coupling(spectrum, coupling, doppler_window=window)
    return spectrum, (spectrum.real**2 + spectrum.imag**2).sum(0)


def _candidates(power, mask, radar, range_bias_m):
    """Power of the cells in `mask` that may become points, 0 elsewhere.

    Three kinds of range bins are excluded: bin 0, which is the sensor itself; bins that
    the bias moves to 0 or below; and the last two, into which the window spreads the
    leakage of the antennas.
    """
    first = max(1, math.floor(range_bias_m / radar.range_resolution_m + 0.5) + 1)
    candidates = jnp.where(mask, power, 0.0).at[:, :first].set(0.0)
    return candidates.at[:, -WRAPPED:].set(0.0)


def _strongest_cells(candidates, points):
    """Power and flat index of the strongest candidates, padded with power 0."""
    candidates = candidates.ravel()
    count = min(points.capacity, candidates.size)
    strongest, cell = jax.lax.top_k(candidates, count)
    padding = (0, points.capacity - count)
    return jnp.pad(strongest, padding), jnp.pad(cell, padding)


def _bins(power, cell, points):
    """Range bin and signed Doppler bin of flat cells."""
    num_doppler, num_range = power.shape
    row, column = jnp.divmod(cell, num_range)
    doppler_bin = (row - num_doppler // 2).astype(power.dtype)
    range_bin = column.astype(power.dtype)
    if points.refine:
        left, right = jnp.maximum(column - 1, 0), jnp.minimum(column + 1, num_range - 1)
        range_bin += window_offset(
            power[row, left],
            power[row, column],
            power[row, right],
            kind=points.range_window,
            length=num_range,
        )
    if points.refine and num_doppler > 2:
        below, above = (row - 1) % num_doppler, (row + 1) % num_doppler
        doppler_bin += window_offset(
            power[below, column],
            power[row, column],
            power[above, column],
            kind=points.doppler_window,
            length=num_doppler,
        )
    return range_bin, doppler_bin


def _neighbours(spectrum, cell):
    """Spectra in the range cells before, at and after, `[cell 3 virtual]`."""
    num_range = spectrum.shape[-1]
    row, column = jnp.divmod(cell, num_range)
    near = jnp.clip(column[:, None] + jnp.array([[-1, 0, 1]]), 0, num_range - 1)
    return jnp.moveaxis(spectrum[:, row[:, None], near], 0, -1)


def _focused(spectrum, cell, range_bin, doppler_bin, radar, points, range_bias_m):
    """Azimuth and elevation of each cell by `focused_directions`."""
    near = _neighbours(spectrum, cell)
    doppler_bin = jnp.broadcast_to(doppler_bin[:, None], near.shape[:2])
    column = cell % spectrum.shape[-1]
    return focused_directions(
        compensate_tdm(near, doppler_bin, radar),
        column,
        range_bin - column,
        radar,
        range_bias_m=range_bias_m,
        range_window=points.range_window,
        **_angle_bins(points, radar),
        **_fields(points, FLIPS),
    )


def _directions(snapshot, radar, points):
    """Azimuth and elevation of the strongest direction of each snapshot."""
    options = _fields(points, FLIPS)
    if points.angles == "music":
        sources = points.sources or None
        return music_directions(snapshot, radar, num_sources=sources, **options)
    if points.angles == "capon":
        return capon_directions(snapshot, radar, **options)
    options |= _angle_bins(points, radar)
    return directions(snapshot, radar, interpolate=points.refine, **options)


def _angle_bins(points, radar):
    """Numbers of bins of the angle spectra."""
    return {
        "num_azimuth": points.num_azimuth or azimuth_bins(radar),
        "num_elevation": points.num_elevation,
    }


def _fields(points, names):
    return {name: getattr(points, name) for name in names}


def _strongest_peaks(power, snapshot, radar, points):
    """Power, direction and place in `power` of the strongest of all peaks.

    A cell's first peak has the power of its cell. The peaks of all cells therefore
    include the strongest ones of the frame.
    """

    def peaks_of(snapshot):
        spectrum = angle_spectrum(snapshot, radar, **_angle_bins(points, radar))
        options = {"count": points.peaks, "interpolate": points.refine}
        return spectrum_peaks(spectrum, radar, **options, **_fields(points, FLIPS))

    peaks = jax.lax.map(peaks_of, snapshot, batch_size=SPECTRA)
    share = peaks.power / jnp.maximum(peaks.power[:, :1], 1e-30)
    powers = jnp.where(peaks.valid, power[:, None] * share, 0.0)
    strongest, peak = jax.lax.top_k(powers.ravel(), len(power))
    direction = peaks.azimuth.ravel()[peak], peaks.elevation.ravel()[peak]
    return strongest, direction, peak // powers.shape[-1]


def _cloud(power, cell, strongest, direction, radar, points, range_bias_m):
    """The cloud of the cells; those without power are padding."""
    azimuth, elevation = direction
    range_bin, doppler_bin = _bins(power, cell, points)
    noise = noise_floor(power, guard=points.guard, train=points.train)
    noise = noise.ravel()[cell]
    distance = range_bin * radar.range_resolution_m - range_bias_m
    ground = distance * jnp.cos(elevation)
    xyz = [
        ground * jnp.cos(azimuth),
        ground * jnp.sin(azimuth),
        distance * jnp.sin(elevation),
    ]
    valid = strongest > 0
    return PointCloud(
        xyz=jnp.where(valid[:, None], jnp.stack(xyz, -1), 0.0),
        valid=valid,
        velocity=jnp.where(valid, doppler_bin * radar.velocity_resolution_mps, 0.0),
        power=strongest,
        # The inner condition keeps gradients finite where nothing was received.
        snr=strongest / jnp.where(valid, jnp.maximum(noise, 1e-30), 1.0),
    )
