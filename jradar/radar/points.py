"""Radar cube to point cloud: the paper's section III-A.

There are two ways, which give the same points:

    cube --radar_points--> PointCloud                          detected cells only
    cube --all_cells--> Cells --cell_points(mask)--> PointCloud        every cell

`radar_points` finds the directions of the cells that its CFAR detector marks.
`all_cells` finds the directions of every cell once, so that masks of several detectors,
with a threshold or learned, can be compared. Both take a `PointSpec`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from jradar.compiled import jit
from jradar.options.points import POINTS, PointSpec
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.cell_directions import (
    angle_bins,
    cell_directions,
    focused,
    strongest_peaks,
)
from jradar.radar.angle.folds import Folds, velocity_folds
from jradar.radar.channels import calibrate, compensate_tdm, subtract_leakage
from jradar.radar.detect.cfar import DETECTORS, noise_floor
from jradar.radar.detect.clusters import map_peaks
from jradar.radar.peaks import window_offset
from jradar.radar.radar import Radar
from jradar.radar.ranks import to_rank
from jradar.radar.samples import Cube, as_samples
from jradar.radar.spectrum import STATIC, PowerMap, Spectrum, range_doppler
from jradar.types import PointCloud

WRAPPED = 2  # range bins behind bin 0 that a window's main lobe reaches


class Cells(NamedTuple):
    """Power, summed over antennas, and strongest direction in radians of each cell.

    Cells found with `PointSpec.folds` also have the fold of their velocity.
    """

    power: Float[Array, "*batch doppler range"]
    azimuth: Float[Array, "*batch doppler range"]
    elevation: Float[Array, "*batch doppler range"]
    fold: Int[Array, "*batch doppler range"] | None = None
    fold_margin_db: Float[Array, "*batch doppler range"] | None = None


@jit(static_argnames="points")
def radar_points(cube: Cube, radar: Radar, *, points: PointSpec = POINTS) -> PointCloud:
    """Return the strongest detections of one frame, strongest first.

    The samples are as recorded; the radar's calibration is applied here. Positions are
    those in the middle of the frame. Velocity is in m/s, power in ADC counts squared;
    the SNR compares it with the mean of the training cells. Bin 0 and the last two
    range bins, into which a window spreads the antennas' leakage, never become points.
    With a leakage the range window is Blackman, the only one that its file fits. One
    frame; `vmap` it. Raises ValueError for a cube that does not fit the radar.
    """
    return points_and_count(cube, radar, points=points)[0]


@jit(static_argnames="points")
def points_and_count(
    cube: Cube, radar: Radar, *, points: PointSpec = POINTS
) -> tuple[PointCloud, Int[Array, ""]]:
    """Return `radar_points`, and the number of detected cells at usable ranges.

    The weakest cells beyond the capacity are not in the cloud. A sample that is not
    finite makes the whole spectrum so, and the cloud empty.
    """
    points, spec = points.subtracting(radar.leakage), radar.spec
    spectrum, power = frame_spectra(cube, radar, points)
    candidates = _candidates(power, detect(power, spec, points=points), radar)
    strongest, cell = _strongest_cells(candidates, points)
    snapshot, folds, direction = _located(spectrum, power, cell, radar, points)
    if points.peaks > 1:
        strongest, direction, of = strongest_peaks(strongest, snapshot, spec, points)
        cell = cell[of]
        folds = jax.tree.map(lambda values: values[of], folds)
    cloud = _cloud(power, cell, strongest, direction, folds, radar, points)
    return cloud, (candidates > 0).sum()


@jit(static_argnames="points")
def all_cells(cube: Cube, radar: Radar, *, points: PointSpec = POINTS) -> Cells:
    """Return the power and direction of every cell of one frame; `vmap` it.

    `points.peaks` and the options of detection are not used. Raises ValueError for a
    cube that does not fit the radar.
    """
    points = points.subtracting(radar.leakage)
    spectrum, power = frame_spectra(cube, radar, points)
    cell = jnp.arange(power.size)
    _, folds, direction = _located(spectrum, power, cell, radar, points)
    columns = *direction, *(folds or ())
    return Cells(power, *(column.reshape(power.shape) for column in columns))


@jit(static_argnames="points")
def cell_points(
    cells: Cells,
    mask: Bool[Array, "doppler range"],
    radar: Radar,
    *,
    points: PointSpec = POINTS,
) -> PointCloud:
    """Return the points of the cells in `mask`, strongest first; one frame, `vmap` it.

    With the mask of `detect`, these are the points of `radar_points`.
    """
    points, spec = points.subtracting(radar.leakage), radar.spec
    expected = spec.num_chirps, spec.num_range_bins
    for name, values in (*cells._asdict().items(), ("mask", mask)):
        if values is not None and values.shape != expected:
            raise ValueError(
                f"{name} has shape {values.shape}, {spec.name} needs [doppler, range] "
                f"= {expected}: one frame, or another radar?"
            )
    candidates = _candidates(cells.power, mask, radar)
    strongest, cell = _strongest_cells(candidates, points)
    _, azimuth, elevation, *folds = jax.tree.map(lambda part: part.ravel()[cell], cells)
    folds = None if cells.fold is None else Folds(*folds)
    direction = azimuth, elevation
    return _cloud(cells.power, cell, strongest, direction, folds, radar, points)


@jit(static_argnames=("radar", "points"))
def detect(
    power: Float[Array, "*batch doppler range"], radar: RadarSpec, *, points: PointSpec
) -> Bool[Array, "*batch doppler range"]:
    """Return the cells that the CFAR detector of `points` marks in the summed power.

    With `group_peaks`, only the peaks among them. Raises ValueError where the window
    does not fit into the map.
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


def _located(spectrum, power, cell, radar, points):
    """The array's values in flat cells as if nothing moved, folds, and directions."""
    spec = radar.spec
    range_bin, doppler_bin = cell_bins(power, cell, points)
    snapshot, folds = spectrum.reshape(spec.num_virtual, -1)[:, cell].T, None
    if points.folds:
        folds = velocity_folds(
            jax.lax.stop_gradient(snapshot),  # a fold is a choice
            jax.lax.stop_gradient(doppler_bin),
            spec,
            most=points.folds,
            **angle_bins(points, spec),
        )
        doppler_bin += folds.fold * spec.num_chirps
    snapshot = compensate_tdm(snapshot, doppler_bin, spec)
    if points.focus:
        direction = focused(spectrum, cell, range_bin, doppler_bin, radar, points)
    else:
        direction = cell_directions(snapshot, spec, points)
    return snapshot, folds, direction


def frame_spectra(
    cube: Cube, radar: Radar, points: PointSpec
) -> tuple[Spectrum, PowerMap]:
    """Return `range_doppler` of one frame's calibrated cube without its leakage.

    `remove_static` removes the leakage too, because it is steady. A cube of zeros was
    never received and holds no leakage.
    """
    cube, spec = as_samples(cube), radar.spec
    if cube.shape != spec.cube_shape:
        raise ValueError(
            f"cube has shape {cube.shape}, {spec.name} needs [tx, rx, chirp, sample] "
            f"= {spec.cube_shape}: one frame, or another radar?"
        )
    if jnp.iscomplexobj(cube) == spec.real_samples:
        expected = "real" if spec.real_samples else "complex"
        raise ValueError(
            f"the samples are {cube.dtype}, {spec.name} delivers {expected} ones"
        )
    options = {name: getattr(points, name) for name in STATIC}
    spectrum, power = range_doppler(calibrate(cube, radar), **options)
    if radar.leakage is None or points.remove_static:
        return spectrum, power
    leakage = jnp.where(power.any(), radar.leakage, 0)
    window = points.doppler_window
    spectrum = subtract_leakage(spectrum, leakage, doppler_window=window)
    return spectrum, (spectrum.real**2 + spectrum.imag**2).sum(0)


def _candidates(power, mask, radar):
    """Power of the cells in `mask` at ranges that may become points, 0 elsewhere."""
    bias = jnp.floor(radar.range_bias_m / radar.spec.range_resolution_m + 0.5)
    usable = jnp.arange(power.shape[-1]) > jnp.maximum(bias, 0)
    candidates = jnp.where(mask & to_rank(usable, mask), power, 0.0)
    return candidates.at[..., -WRAPPED:].set(0.0)


def _strongest_cells(candidates, points):
    """Power and flat index of the strongest candidates, padded with power 0."""
    candidates = candidates.ravel()
    count = min(points.capacity, candidates.size)
    strongest, cell = jax.lax.top_k(candidates, count)
    padding = (0, points.capacity - count)
    return jnp.pad(strongest, padding), jnp.pad(cell, padding)


def cell_bins(
    power: PowerMap, cell: Int[Array, " cell"], points: PointSpec
) -> tuple[Float[Array, " cell"], Float[Array, " cell"]]:
    """Return range bins and signed Doppler bins of flat cells, refined if asked for."""
    num_doppler, num_range = power.shape
    row, column = jnp.divmod(cell, num_range)
    doppler_bin = (row - num_doppler // 2).astype(power.dtype)
    range_bin = column.astype(power.dtype)

    def offset(before, after, kind, length):
        around = power[before], power[row, column], power[after]
        return window_offset(*around, kind=kind, length=length)

    if points.refine:
        left, right = jnp.maximum(column - 1, 0), jnp.minimum(column + 1, num_range - 1)
        range_bin += offset((row, left), (row, right), points.range_window, num_range)
    if points.refine and num_doppler > 2:
        below, above = ((step % num_doppler, column) for step in (row - 1, row + 1))
        doppler_bin += offset(below, above, points.doppler_window, num_doppler)
    return range_bin, doppler_bin


def _cloud(power, cell, strongest, direction, folds, radar, points):
    """The cloud of the cells; those without power are padding."""
    (azimuth, elevation), spec = direction, radar.spec
    range_bin, doppler_bin = cell_bins(power, cell, points)
    noise = noise_floor(power, guard=points.guard, train=points.train).ravel()[cell]
    distance = range_bin * spec.range_resolution_m - radar.range_bias_m
    ground = distance * jnp.cos(elevation)
    xyz = [
        ground * jnp.cos(azimuth),
        ground * jnp.sin(azimuth),
        distance * jnp.sin(elevation),
    ]
    valid = strongest > 0
    cloud = PointCloud(
        xyz=jnp.where(valid[:, None], jnp.stack(xyz, -1), 0.0),
        valid=valid,
        velocity=jnp.where(valid, doppler_bin * spec.velocity_resolution_mps, 0.0),
        power=strongest,
        # The inner condition keeps gradients finite where nothing was received.
        snr=strongest / jnp.where(valid, jnp.maximum(noise, 1e-30), 1.0),
    )
    if folds is None:
        return cloud
    fold, margin_db = (jnp.where(valid, part, 0) for part in folds)
    velocity = cloud.velocity + fold * (2 * spec.max_velocity_mps)
    return cloud._replace(velocity=velocity, fold=fold, fold_margin_db=margin_db)
