"""Azimuth and elevation from the phases across the virtual array.

The elements are laid on their grid of half wavelengths, positions held by several
tx-rx pairs averaged, and the grid is zero-padded and Fourier transformed: for a single
target its peak is the maximum-likelihood direction, however sparse the rows are.

    elements [row, column]  --2-D FFT-->  [elevation, azimuth], in direction sines
                                          w = sin el, u = sin az cos el

An array with one row cannot tell elevations apart: its spectrum has one elevation bin,
and its elevation is 0.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.radar.sensor import RadarSpec

Angle = Float[Array, "*batch"]


def direction_sines(
    radar: RadarSpec, *, num_azimuth: int = 64, num_elevation: int = 32
) -> tuple[np.ndarray, np.ndarray]:
    """The bins' direction sines u `[azimuth]` and w `[elevation]`, on the host."""

    def sines(bins):
        return (np.arange(bins) - bins // 2) / (bins * radar.spacing_wavelengths)

    return sines(num_azimuth), sines(num_elevation if radar.has_elevation else 1)


@functools.partial(jax.jit, static_argnames=("radar", "num_azimuth", "num_elevation"))
def angle_spectrum(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    num_azimuth: int = 64,
    num_elevation: int = 32,
) -> Float[Array, "*batch elevation azimuth"]:
    """Power over direction of a cell's values across the antennas.

    Directions are those of `direction_sines`. Raises ValueError where the array has
    more elements along an axis than the spectrum has bins.
    """
    num_elevation = num_elevation if radar.has_elevation else 1
    rows, columns = radar.virtual_positions[:, ::-1].max(0) + 1
    if rows > num_elevation or columns > num_azimuth:
        raise ValueError(
            f"{num_elevation} elevation and {num_azimuth} azimuth bins are fewer than "
            f"the array's {rows} rows and {columns} columns: ask for more bins"
        )
    if snapshot.shape[-1] != radar.num_virtual:
        raise ValueError(
            f"{snapshot.shape[-1]} values per cell, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    column, row = radar.virtual_positions.T
    shared = np.zeros((rows, columns))
    np.add.at(shared, (row, column), 1)
    grid = jnp.zeros((*snapshot.shape[:-1], rows, columns), snapshot.dtype)
    weight = jnp.asarray(1 / shared[row, column], jnp.float32)
    grid = grid.at[..., row, column].add(snapshot * weight)
    spectrum = jnp.fft.fft2(grid, s=(num_elevation, num_azimuth))
    spectrum = jnp.fft.fftshift(spectrum, axes=(-2, -1))
    return spectrum.real**2 + spectrum.imag**2


@functools.partial(jax.jit, static_argnames=("radar", "interpolate"))
def strongest_direction(
    spectrum: Float[Array, "*batch elevation azimuth"],
    radar: RadarSpec,
    *,
    interpolate: bool = True,
) -> tuple[Angle, Angle]:
    """Azimuth and elevation in radians of the peak of an `angle_spectrum`.

    `interpolate` places it between bins, by a parabola through the logarithms of its
    neighbours, which also makes it differentiable. Bins with u^2 + w^2 > 1, which no
    direction reaches, are passed over.
    """
    *batch, num_elevation, num_azimuth = spectrum.shape
    u, w = direction_sines(radar, num_azimuth=num_azimuth, num_elevation=num_elevation)
    visible = u**2 + w[:, None] ** 2 <= 1
    flat = jnp.where(visible, spectrum, -1.0).reshape(*batch, -1)
    row, column = jnp.divmod(jnp.argmax(flat, -1), num_azimuth)

    def offset(step_row, step_column):
        """Bins from the peak to the vertex of the parabola along an axis."""
        index = [
            (row + k * step_row) % num_elevation * num_azimuth
            + (column + k * step_column) % num_azimuth
            for k in (-1, 0, 1)
        ]
        power = jnp.take_along_axis(
            spectrum.reshape(*batch, -1), jnp.stack(index, -1), -1
        )
        before, peak, after = jnp.moveaxis(jnp.log(power + 1e-30), -1, 0)
        curvature = 2 * peak - before - after
        safe = jnp.where(curvature > 0, curvature, 1.0)
        shift = jnp.where(curvature > 0, (after - before) / (2 * safe), 0.0)
        return jnp.clip(shift, -0.5, 0.5)

    sine_az, sine_el = jnp.asarray(u)[column], jnp.asarray(w)[row]
    if interpolate:
        sine_az += offset(0, 1) * (u[1] - u[0])
    if interpolate and num_elevation > 1:
        sine_el += offset(1, 0) * (w[1] - w[0])
    sine_el = jnp.clip(sine_el, -1 + 1e-6, 1 - 1e-6)
    sine_az = sine_az / jnp.sqrt(1 - sine_el**2)
    return jnp.arcsin(jnp.clip(sine_az, -1 + 1e-6, 1 - 1e-6)), jnp.arcsin(sine_el)
