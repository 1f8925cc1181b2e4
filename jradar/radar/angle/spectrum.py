"""Azimuth and elevation from the phases across the virtual array.

The elements lie on a grid of columns and rows; tx-rx pairs at the same position are
averaged. The grid is zero-padded and Fourier transformed. For a single target, the peak
of the spectrum is the maximum-likelihood direction, even with sparse rows.

    elements [row, column]  --2-D FFT-->  [elevation, azimuth], in direction sines
                                          w = sin el, u = sin az cos el

An array with one row does not measure elevation: its spectrum has one elevation bin,
and its elevation is 0. Likewise, an array with one column does not measure azimuth.
Positions grow to the left and upwards as seen from behind.

`direction` finds the strongest direction faster, without this spectrum.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.channels import check_antennas, compensate_tdm
from jradar.radar.peaks import local_maxima, parabola_offset
from jradar.radar.ranks import to_rank

Angle = Float[Array, "*batch"]
NEARLY_ONE = 1 - 1e-6  # the slope of the arcsine is still finite here
WEAKEST = 10**-0.6  # of a cell's peaks, relative to its strongest


class Peaks(NamedTuple):
    """Directions of the peaks of a cell in radians, strongest first."""

    azimuth: Float[Array, "*batch peak"]
    elevation: Float[Array, "*batch peak"]
    power: Float[Array, "*batch peak"]
    valid: Bool[Array, "*batch peak"]


def direction_sines(
    radar: RadarSpec, *, num_azimuth: int = 64, num_elevation: int = 32
) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction sines of the bins: u `[azimuth]`, w `[elevation]`; host."""

    def sines(bins, spacing):
        return (np.arange(bins) - bins // 2) / (bins * spacing)

    rows = num_elevation if radar.has_elevation else 1
    columns = num_azimuth if radar.has_azimuth else 1
    return (
        sines(columns, radar.spacing_wavelengths),
        sines(rows, radar.row_spacing_wavelengths),
    )


def azimuth_bins(radar: RadarSpec) -> int:
    """Return the number of azimuth bins for an array: 64, or more if it is wider.

    With fewer than two bins a column, a parabola errs by more than noise at 10 dB.
    """
    columns = int(radar.virtual_positions[:, 0].max()) + 1
    return max(64, 1 << (2 * columns - 1).bit_length())


def check_sizes(
    shape: tuple[int, ...], radar: RadarSpec, num_azimuth: int, num_elevation: int
) -> tuple[int, int]:
    """Return the rows and columns of the array; ValueError if shapes do not fit."""
    rows, columns = (int(size) for size in radar.virtual_positions[:, ::-1].max(0) + 1)
    if (radar.has_elevation and rows > num_elevation) or columns > num_azimuth:
        raise ValueError(
            f"{num_elevation} elevation and {num_azimuth} azimuth bins are fewer than "
            f"the array's {rows} rows and {columns} columns: ask for more bins"
        )
    check_antennas(shape, radar)
    return rows, columns


@jit(static_argnames=("radar", "num_azimuth", "num_elevation"))
def angle_spectrum(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    num_azimuth: int = 64,
    num_elevation: int = 32,
) -> Float[Array, "*batch elevation azimuth"]:
    """Return the power of each snapshot over the directions of `direction_sines`.

    Raises ValueError if the array has more elements along an axis than the spectrum
    has bins.
    """
    rows, columns = check_sizes(snapshot.shape, radar, num_azimuth, num_elevation)
    num_elevation = num_elevation if radar.has_elevation else 1
    num_azimuth = num_azimuth if radar.has_azimuth else 1
    column, row = radar.virtual_positions.T
    shared = np.zeros((rows, columns))
    np.add.at(shared, (row, column), 1)
    grid = jnp.zeros((*snapshot.shape[:-1], rows, columns), snapshot.dtype)
    weight = jnp.asarray(1 / shared[row, column], jnp.float32)
    grid = grid.at[..., row, column].add(snapshot * to_rank(weight, snapshot))
    spectrum = jnp.fft.fft2(grid, s=(num_elevation, num_azimuth))
    spectrum = jnp.fft.fftshift(spectrum, axes=(-2, -1))
    return spectrum.real**2 + spectrum.imag**2


@jit(static_argnames="radar")
def azimuth_map(
    spectrum: Complex[Array, "virtual doppler sample"],
    power: Float[Array, "doppler sample"],
    radar: RadarSpec,
) -> Float[Array, "range azimuth"]:
    """Return the power of each range over the `direction_sines` of the azimuth.

    Takes what `range_doppler` returns for one frame. Each range shows its strongest
    velocity, and each azimuth its strongest elevation.
    """
    bins = jnp.arange(radar.num_range_bins)
    row = power[:, bins].argmax(0)
    snapshot = spectrum[:, row, bins].T
    snapshot = compensate_tdm(snapshot, row - power.shape[0] // 2, radar)
    return angle_spectrum(snapshot, radar).max(-2)


@jit(static_argnames=("radar", "count", "interpolate"))
def spectrum_peaks(
    spectrum: Float[Array, "*batch elevation azimuth"],
    radar: RadarSpec,
    *,
    count: int = 2,
    interpolate: bool = True,
) -> Peaks:
    """Return the `count` strongest local maxima of an `angle_spectrum`.

    A maximum exceeds its eight neighbours among the bins with u^2 + w^2 <= 1; other
    bins are not directions. It is `valid` if it lies at most 6 dB below the strongest:
    uniform rows have side lobes 13 dB down, sparse rows higher ones. `interpolate`
    places it between bins by parabolas and makes it differentiable. A spectrum over
    azimuth only has one row.
    """
    *batch, num_elevation, num_azimuth = spectrum.shape
    if not 1 <= count <= num_elevation * num_azimuth:
        raise ValueError(
            f"{count=}, expected 1 to the spectrum's {num_elevation} x {num_azimuth} "
            "bins"
        )
    u, w = direction_sines(radar, num_azimuth=num_azimuth, num_elevation=num_elevation)
    seen = jnp.where(u**2 + w[:, None] ** 2 <= 1, spectrum, -1.0)
    left = jnp.where(local_maxima(seen), seen, -1.0).reshape(*batch, -1)
    bins, powers = [], []
    for _ in range(count):  # faster than a sort for a few peaks
        bins.append(jnp.argmax(left, -1))
        powers.append(jnp.take_along_axis(left, bins[-1][..., None], -1)[..., 0])
        chosen = to_rank(jnp.arange(left.shape[-1]), left) == bins[-1][..., None]
        left = jnp.where(chosen, -1.0, left)
    sines = (_sines(spectrum, index, u, w, interpolate) for index in bins)
    azimuth, elevation = angles_of_sines(
        *(jnp.stack(sine, -1) for sine in zip(*sines, strict=True))
    )
    power = jnp.stack(powers, -1)
    valid = (power > 0) & (power >= WEAKEST * power[..., :1])
    return Peaks(azimuth, elevation, jnp.maximum(power, 0.0), valid)


def angles_of_sines(u: Angle, w: Angle) -> tuple[Angle, Angle]:
    """Return azimuth and elevation in radians, with finite gradients."""
    w = jnp.clip(w, -NEARLY_ONE, NEARLY_ONE)
    sine = jnp.clip(u / jnp.sqrt(1 - w**2), -NEARLY_ONE, NEARLY_ONE)
    return jnp.arcsin(sine), jnp.arcsin(w)


def _sines(spectrum, index, u, w, interpolate):
    """Direction sines of the peak in the flat bin `index`; `u`, `w` are the bins'."""
    *batch, num_elevation, num_azimuth = spectrum.shape
    row, column = jnp.divmod(index, num_azimuth)
    flat = spectrum.reshape(*batch, -1)

    def offset(step_row, step_column):
        """Bins from the peak to the vertex of the parabola along one axis."""
        near = [
            (row + k * step_row) % num_elevation * num_azimuth
            + (column + k * step_column) % num_azimuth
            for k in (-1, 0, 1)
        ]
        power = jnp.take_along_axis(flat, jnp.stack(near, -1), -1)
        return parabola_offset(*jnp.moveaxis(power, -1, 0))

    sine_az, sine_el = jnp.asarray(u)[column], jnp.asarray(w)[row]
    if interpolate and num_azimuth > 1:
        sine_az += offset(0, 1) * (u[1] - u[0])
    if interpolate and num_elevation > 1:
        sine_el += offset(1, 0) * (w[1] - w[0])
    return sine_az, sine_el
