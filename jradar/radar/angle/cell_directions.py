"""Directions of range-Doppler cells, by the method that a `PointSpec` names."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Int

from jradar.options.points import PointSpec
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import directions
from jradar.radar.angle.near_field import focused_directions
from jradar.radar.angle.spectrum import angle_spectrum, azimuth_bins, spectrum_peaks
from jradar.radar.angle.subspace import subspace_directions
from jradar.radar.angle.subspace_peaks import subspace_peaks
from jradar.radar.channels import compensate_tdm
from jradar.radar.radar import Radar

Angles = Float[Array, "..."]

SPECTRA = 64  # angle spectra that are held in memory at a time


def focused(
    spectrum: Complex[Array, "virtual doppler range"],
    cell: Int[Array, " point"],
    range_bin: Float[Array, " point"],
    doppler_bin: Float[Array, " point"],
    radar: Radar,
    points: PointSpec,
) -> tuple[Angles, Angles]:
    """Azimuth and elevation of each flat cell by `focused_directions`."""
    num_range = spectrum.shape[-1]
    row, column = jnp.divmod(cell, num_range)
    near = jnp.clip(column[:, None] + jnp.array([[-1, 0, 1]]), 0, num_range - 1)
    cells = jnp.moveaxis(spectrum[:, row[:, None], near], 0, -1)  # [cell 3 virtual]
    doppler_bin = jnp.broadcast_to(doppler_bin[:, None], near.shape)
    return focused_directions(
        compensate_tdm(cells, doppler_bin, radar.spec),
        column,
        range_bin - column,
        radar.spec,
        range_bias_m=radar.range_bias_m,
        range_window=points.range_window,
        **angle_bins(points, radar.spec),
    )


def cell_directions(
    snapshot: Complex[Array, "*batch virtual"], radar: RadarSpec, points: PointSpec
) -> tuple[Angles, Angles]:
    """Azimuth and elevation of the strongest direction of each snapshot."""
    if points.angles == "fft":
        bins = angle_bins(points, radar)
        return directions(snapshot, radar, interpolate=points.refine, **bins)
    return subspace_directions(
        snapshot, radar, method=points.angles, num_sources=points.sources
    )


def angle_bins(points: PointSpec, radar: RadarSpec) -> dict[str, Any]:
    """Numbers of bins of the angle spectra."""
    return {
        "num_azimuth": points.num_azimuth or azimuth_bins(radar),
        "num_elevation": points.num_elevation,
    }


def strongest_peaks(
    power: Float[Array, " point"],
    snapshot: Complex[Array, "point virtual"],
    radar: RadarSpec,
    points: PointSpec,
) -> tuple[Float[Array, " point"], tuple[Angles, Angles], Int[Array, " point"]]:
    """Power, direction and index in `power` of the strongest peaks of the frame.

    A cell's first peak has the power of its cell. The peaks of all cells therefore
    include the strongest ones of the frame.
    """
    options: dict[str, Any] = {"count": points.peaks}

    def peaks_of(snapshot):
        spectrum = angle_spectrum(snapshot, radar, **angle_bins(points, radar))
        return spectrum_peaks(spectrum, radar, interpolate=points.refine, **options)

    if points.angles == "fft":
        peaks = jax.lax.map(peaks_of, snapshot, batch_size=SPECTRA)
    else:
        options |= {"method": points.angles, "num_sources": points.sources}
        peaks = subspace_peaks(snapshot, radar, **options)
    strongest = peaks.power[:, :1]
    share = peaks.power / jnp.where(strongest > 1e-30, strongest, 1e-30)
    powers = jnp.where(peaks.valid, power[:, None] * share, 0.0)
    strongest, peak = jax.lax.top_k(powers.ravel(), len(power))
    direction = peaks.azimuth.ravel()[peak], peaks.elevation.ravel()[peak]
    return strongest, direction, peak // powers.shape[-1]
