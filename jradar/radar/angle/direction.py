"""The strongest direction of each snapshot, without its whole angle spectrum.

Elements of one row r differ in azimuth only. One small matrix product gives their sums
s_r(u) for all azimuth bins. Over the elevation phase p = 2 pi d_r w, the power is then

    |sum_r s_r e^(-j r p)|^2 = sum_r |s_r|^2 + 2 Re sum_l c_l e^(-j l p)

where c_l is the sum of s_q conj(s_r) over rows with q - r = l:

    one row      no elevation
    two rows     closed form: the maximum (|s_0| + |s_1|)^2 is at p = arg(c_l) / l
    more rows    a real matrix product from lags to elevation bins

The azimuth of the joint maximum is refined between bins; the elevation is then computed
at the refined azimuth.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.spectrum import (
    NEARLY_ONE,
    Angle,
    angles_of_sines,
    check_sizes,
    direction_sines,
)
from jradar.radar.peaks import parabola_offset

BLOCK = 64  # cells whose arrays stay in a core's cache; twice as many for few rows
SHORT = 16  # longest row for which Horner's rule is unrolled
TINY = 1e-30
NUM_ELEVATION = 32  # bins


class _Row(NamedTuple):
    """Elements of one row: their part of the reordered snapshot, columns, weights."""

    row: int
    part: slice
    columns: np.ndarray
    weights: np.ndarray  # 1 / number of elements at the position


@jit(static_argnames=("radar", "num_azimuth", "num_elevation", "interpolate"))
def directions(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    num_azimuth: int = 64,
    num_elevation: int = NUM_ELEVATION,
    interpolate: bool = True,
) -> tuple[Angle, Angle]:
    """Return azimuth and elevation in radians of the strongest direction.

    The result is the first of `spectrum_peaks` of the `angle_spectrum`, but faster. For
    arrays of two rows the elevation follows from the phase between them, independently
    of `num_elevation`; if several fit, it is the smallest. `interpolate` places angles
    between bins and makes them differentiable. Raises ValueError as `angle_spectrum`.
    """
    check_sizes(snapshot.shape, radar, num_azimuth, num_elevation)
    *batch, num_virtual = snapshot.shape
    order, rows = _rows(radar)
    cells = snapshot.reshape(-1, num_virtual)
    if (order != np.arange(num_virtual)).any():
        cells = cells[:, order]

    def block_sines(cells):
        largest = jnp.maximum(jnp.abs(cells.real), jnp.abs(cells.imag)).max(-1)
        scale = 1 / jnp.where(largest > 0, largest, 1.0)
        cells = cells.T * jax.lax.stop_gradient(scale)[None]
        u = _azimuth_sine(cells, rows, radar, num_azimuth, num_elevation, interpolate)
        return u, _elevation_sine(cells, u, rows, radar, num_elevation, interpolate)

    block = BLOCK if len(rows) > 2 else 2 * BLOCK
    u, w = _in_blocks(block_sines, cells, block)
    return angles_of_sines(u.reshape(batch), w.reshape(batch))


@jit(static_argnames="radar")
def elevation_sines(
    snapshot: Complex[Array, "*batch virtual"],
    u: Float[Array, "*batch"],
    radar: RadarSpec,
) -> Float[Array, "*batch"]:
    """Return the direction sine w of the strongest elevation at azimuth sine u.

    The last step of `directions`; 0 for an array of one row.
    """
    check_sizes(snapshot.shape, radar, radar.num_virtual, NUM_ELEVATION)
    order, rows = _rows(radar)
    cells = snapshot.reshape(-1, radar.num_virtual)[:, order].T
    scale = jax.lax.stop_gradient(jnp.abs(cells).max(0))
    cells = cells / jnp.where(scale > 0, scale, 1.0)[None]
    w = _elevation_sine(cells, u.ravel(), rows, radar, NUM_ELEVATION, True)
    return w.reshape(u.shape)


def _rows(radar):
    """The order that groups elements by row, and the rows in that order."""
    _, place, shared = np.unique(
        radar.virtual_positions, axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(radar.virtual_positions[:, 1], kind="stable")
    columns, row = radar.virtual_positions[order].T
    weights = 1 / shared[place.ravel()[order]]
    values, starts = np.unique(row, return_index=True)
    parts = map(slice, starts, [*starts[1:], len(row)])
    rows = [
        _Row(int(value), part, columns[part], weights[part])
        for value, part in zip(values, parts, strict=True)
    ]
    return order, rows


def _in_blocks(function, cells, block):
    """Apply `function` to blocks of `[cell, virtual]` and join its results `[cell]`."""
    count, num_virtual = cells.shape
    if count <= block:
        return function(cells)
    num_blocks = -(-count // block)
    padded = jnp.pad(cells, ((0, num_blocks * block - count), (0, 0)))
    blocks = padded.reshape(num_blocks, block, num_virtual)
    return tuple(out.ravel()[:count] for out in jax.lax.map(function, blocks))


def _azimuth_sine(cells, rows, radar, num_azimuth, num_elevation, interpolate):
    """Direction sine u of the strongest azimuth of `[virtual, cell]`."""
    if not radar.has_azimuth:
        return jnp.zeros(cells.shape[1:], cells.real.dtype)
    u, w = direction_sines(radar, num_azimuth=num_azimuth, num_elevation=num_elevation)
    sums = _sums_over_bins(cells, rows, radar, u)
    power = _power_over_azimuth(sums, rows, radar, u, w)
    seen = jnp.where((np.abs(u) <= 1)[:, None], power, -1.0)
    # Two vectorised reductions; argmax would run cell by cell.
    bins = np.arange(num_azimuth, dtype=np.int32)[:, None]
    index = jnp.where(seen == seen.max(0, keepdims=True), bins, num_azimuth - 1).min(0)
    sine = jnp.asarray(u, jnp.float32)[index]
    if not interpolate:
        return sine
    sine += _offset(power, index) * (u[1] - u[0])
    return jnp.clip(sine, -NEARLY_ONE, NEARLY_ONE)


def _elevation_sine(cells, u, rows, radar, num_elevation, interpolate):
    """Direction sine w of the strongest elevation at the direction sines u `[cell]`."""
    if len(rows) == 1:
        return jnp.zeros_like(u)
    limit = jnp.sqrt(jnp.maximum(1 - u**2, 1 - NEARLY_ONE**2))
    constant, lags = _lags(_sums_at(cells, rows, radar, u), rows)
    if len(rows) == 2:
        ((lag, (real, imag)),) = lags.items()
        known = real**2 + imag**2 > TINY
        phase = jnp.arctan2(jnp.where(known, imag, 0.0), jnp.where(known, real, 1.0))
        w = phase / (2 * np.pi * radar.row_spacing_wavelengths * lag)
        return jnp.clip(w, -limit, limit)
    _, bins = direction_sines(radar, num_azimuth=1, num_elevation=num_elevation)
    power = _power_over_elevation(constant, lags, radar, bins)
    visible = np.abs(bins).astype(np.float32)[:, None] <= limit[None]
    index = jnp.argmax(jnp.where(visible, power, -1.0), 0)
    w = jnp.asarray(bins, jnp.float32)[index]
    if interpolate:
        w += _offset(power, index) * (bins[1] - bins[0])
    return jnp.clip(w, -limit, limit)


def _offset(power, index):
    """Bins from the peaks of `[bin, cell]` to the vertices of their parabolas."""
    near = jnp.stack([index - 1, index, index + 1]) % len(power)
    return parabola_offset(*jnp.take_along_axis(power, near, 0, mode="clip"))


def _sums_over_bins(cells, rows, radar, u):
    """Sums of the rows towards every azimuth bin: real, imaginary `[azimuth, cell]`."""
    half, (_, num_cells) = len(u) // 2, cells.shape
    turn = 2 * np.pi * radar.spacing_wavelengths * -u[half::-1]
    sums = []
    for row in rows:  # bins to the left and to the right share the products
        phase = np.outer(turn, row.columns)
        waves = np.concatenate([np.cos(phase), np.sin(phase)]) * row.weights
        part = cells[row.part]
        both = jnp.concatenate([part.real, part.imag], 1)
        product = waves.astype(np.float32) @ both
        even, odd = product[: half + 1], product[half + 1 :]
        real, imag = even[:, :num_cells], even[:, num_cells:]
        cross_real, cross_imag = odd[:, num_cells:], -odd[:, :num_cells]
        sums.append(
            tuple(
                jnp.concatenate(
                    [(same - cross)[half:0:-1], (same + cross)[: len(u) - half]]
                )
                for same, cross in ((real, cross_real), (imag, cross_imag))
            )
        )
    return sums


def _sums_at(cells, rows, radar, u):
    """Sums of the rows towards one azimuth for each cell: real, imaginary `[cell]`."""
    turn = 2 * np.pi * radar.spacing_wavelengths * u
    cosine, sine = jnp.cos(turn), jnp.sin(turn)
    sums = []
    for row in rows:
        part, first, last = cells[row.part], row.columns[0], row.columns[-1]
        if row.columns.size > SHORT or (np.diff(row.columns) != 1).any():
            phase, weights = turn[None] * row.columns[:, None], row.weights[:, None]
            c, s = jnp.cos(phase) * weights, jnp.sin(phase) * weights
            real = (part.real * c + part.imag * s).sum(0)
            imag = (part.imag * c - part.real * s).sum(0)
        else:  # Horner's rule: sines are slow on CPUs
            real = imag = jnp.zeros_like(u)
            for column in range(last, -1, -1):
                real, imag = real * cosine + imag * sine, imag * cosine - real * sine
                if column >= first:
                    real += part[column - first].real
                    imag += part[column - first].imag
        sums.append((real, imag))
    return sums


def _lags(sums, rows):
    """The power of all rows, and the sum of s_q conj(s_r) for each lag between rows."""
    constant = sum((real**2 + imag**2 for real, imag in sums), jnp.zeros(()))
    lags = {}
    for q, (real_q, imag_q) in enumerate(sums):
        for r, (real_r, imag_r) in enumerate(sums[:q]):
            lag = rows[q].row - rows[r].row
            real, imag = lags.get(lag, (0.0, 0.0))
            lags[lag] = (
                real + real_q * real_r + imag_q * imag_r,
                imag + imag_q * real_r - real_q * imag_r,
            )
    return constant, lags


def _power_over_azimuth(sums, rows, radar, u, w):
    """Maximum over the visible elevations of the power in each azimuth bin."""
    constant, lags = _lags(sums, rows)
    if len(rows) == 1:
        return constant
    highest = np.sqrt(np.maximum(1 - u**2, 0))[:, None]  # |w| in that bin
    if len(rows) == 2:
        # c cos(p) + s sin(p) has its maximum |c + j s| at a visible phase, or else at
        # the nearer end of the visible phases.
        ((lag, (real, imag)),) = lags.items()
        end = 2 * np.pi * radar.row_spacing_wavelengths * lag * highest
        cosine = np.where(end < np.pi, np.cos(end), -2.0).astype(np.float32)
        peak = jnp.sqrt(jnp.maximum(real**2 + imag**2, TINY))
        edge = real * cosine + jnp.abs(imag) * np.sin(end).astype(np.float32)
        return constant + 2 * jnp.where(real >= peak * cosine, peak, edge)
    power = _power_over_elevation(constant, lags, radar, w)
    visible = np.abs(w)[:, None, None] <= highest
    return jnp.where(visible, power, 0.0).max(0)


def _power_over_elevation(constant, lags, radar, w):
    """Power in every elevation bin, `[elevation, ...]`, from the lags between rows."""
    phase = 2 * np.pi * radar.row_spacing_wavelengths * np.outer(w, [*lags])
    waves = np.stack([np.cos(phase), np.sin(phase)], -1).reshape(len(w), -1)
    waves = np.concatenate([np.ones((len(w), 1)), 2 * waves], -1).astype(np.float32)
    parts = [constant, *(part for pair in lags.values() for part in pair)]
    stacked = jnp.stack(parts).reshape(len(parts), -1)
    return (jnp.asarray(waves) @ stacked).reshape(len(w), *constant.shape)
