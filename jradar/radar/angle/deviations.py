"""Standard deviations of a point's range, velocity, azimuth and elevation.

They follow from the SNR of the point, the windows, and the positions of the antennas,
for one target in white noise, to first order in the noise:

    range, velocity    the noise of the three cells that place the peak between bins,
                       and the bias of a rectangular window, an eighth of a bin
    direction sines    the Cramer-Rao bound of the array, and the effect of a velocity
                       error on the phases between the transmitters' chirps

Other targets within a beam or two bins, interference and errors of calibration add to
these. A weak SNR adds a tenth below 15 dB for 12 antennas, and a half below 20 dB for
192.
"""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.options.points import PointSpec
from jradar.options.sensor import RadarSpec
from jradar.radar.peaks import lobe, unbiased_coefficients, vertex_and_slopes
from jradar.radar.spectrum import window
from jradar.types import PointCloud

OFFSETS = np.linspace(-0.5, 0.5, 41)  # of targets between bins, which are averaged
LEAST_SNR = 1e-3


class Deviations(NamedTuple):
    """Standard deviations of points; infinite for padding and unmeasured values."""

    range_m: Float[Array, "*batch point"]
    velocity_mps: Float[Array, "*batch point"]
    azimuth: Float[Array, "*batch point"]  # radians
    elevation: Float[Array, "*batch point"]  # radians


@jit(static_argnames=("radar", "points"))
def point_deviations(
    cloud: PointCloud, radar: RadarSpec, *, points: PointSpec | None = None
) -> Deviations:
    """Return the standard deviations of the points of `radar_points` with `points`.

    An array without an aperture along an axis does not measure that angle. With a
    coupling, pass `points.subtracting(coupling)`. Raises ValueError for a cloud without
    SNR, and for points that lie on bins.
    """
    if cloud.snr is None:
        raise ValueError("the cloud has no snr: pass the cloud of radar_points")
    points = points or PointSpec()
    if not points.refine:
        raise ValueError(
            "points.refine = False: such points lie on bins, up to half a bin from the "
            "target, expected refined ones"
        )
    snr = jnp.maximum(cloud.snr - 1, LEAST_SNR)  # of one antenna, without the noise
    whole = jnp.sqrt(snr * radar.num_virtual)

    def bins(kind, length):
        noise = offset_deviation(kind, length) / whole
        return jnp.sqrt(noise**2 + offset_bias(kind, length) ** 2)

    in_range = bins(points.range_window, radar.num_samples)
    in_doppler = bins(points.doppler_window, radar.num_chirps)
    covariance = _sine_covariance(radar, snr, in_doppler)
    azimuth, elevation = _angle_deviations(cloud.xyz, covariance, points)
    values = (
        in_range * radar.range_resolution_m,
        in_doppler * radar.velocity_resolution_mps,
        azimuth,
        elevation,
    )
    return Deviations(*(jnp.where(cloud.valid, value, jnp.inf) for value in values))


@functools.cache
def offset_deviation(kind: str, length: int) -> float:
    """Return the deviation of `window_offset` in bins at a summed SNR of 1; host.

    It is the root mean square over targets between bins. The SNR is that of the peak's
    cell, summed over antennas. It is infinite where no three bins exist.
    """
    if length < 3:
        return np.inf
    shape, power, vertex, slopes = _parabolas(kind, length)
    coefficients = np.array(unbiased_coefficients(kind, length))
    degrees = np.arange(len(coefficients))
    steep = vertex[:, None] ** (2 * degrees) @ ((2 * degrees + 1) * coefficients)
    slopes = slopes * steep[:, None]
    turns = np.exp(2j * np.pi * np.arange(length) / length)
    lag = np.arange(3)[:, None] - np.arange(3)
    weight = window(kind, length) ** 2
    noise = (weight * turns ** -lag[..., None]).sum(-1)
    mixed = (shape.conj()[:, :, None] * noise * shape[:, None]).real
    mixed /= power[:, :, None] * power[:, None]
    mixed *= 2 * power[:, 1, None, None] / noise[0, 0].real
    variance = np.einsum("ok,okl,ol->o", slopes, mixed, slopes)
    return float(np.sqrt(variance.mean()))


@functools.cache
def offset_bias(kind: str, length: int) -> float:
    """Return the error of `window_offset` in bins without noise; host.

    It is the root mean square over targets between bins, and almost 0 where the
    parabola's bias is removed.
    """
    if length < 3:
        return 0.0
    _, _, vertex, _ = _parabolas(kind, length)
    coefficients = np.array(unbiased_coefficients(kind, length))
    powers = vertex[:, None] ** (2 * np.arange(len(coefficients)) + 1)
    found = np.clip(powers @ coefficients, -0.5, 0.5)
    return float(np.sqrt(((found - OFFSETS) ** 2).mean()))


def _parabolas(kind, length):
    """Lobes of targets between bins, their powers, vertices and slopes; host."""
    shape = lobe(kind, length, OFFSETS)
    power = np.maximum(np.abs(shape) ** 2, 1e-6 * np.abs(shape[:, 1:2]) ** 2)
    return shape, power, *vertex_and_slopes(np.log(power))


def _sine_covariance(radar, snr, in_doppler):
    """Variances of u and w, and their covariance, each `[*batch, point]`."""
    columns, rows = radar.virtual_positions.T
    cycles = np.stack(
        [columns * radar.spacing_wavelengths, rows * radar.row_spacing_wavelengths]
    )
    phase = 2 * np.pi * (cycles - cycles.mean(1, keepdims=True))
    lead = np.repeat(radar.firing_position, radar.num_rx) / radar.num_tx
    lead = 2 * np.pi * (lead - lead.mean()) / radar.num_chirps
    measured = [axis for axis in (0, 1) if np.ptp(phase[axis]) > 0]
    inverse, pull = np.zeros((2, 2)), np.zeros(2)
    if measured:
        part = np.linalg.pinv(phase[measured] @ phase[measured].T)
        inverse[np.ix_(measured, measured)] = part
        pull[measured] = part @ phase[measured] @ lead  # sine per Doppler bin
    for axis in {0, 1} - set(measured):
        inverse[axis, axis] = np.inf
    wrong = jnp.where(jnp.isfinite(in_doppler), in_doppler, 0.0) ** 2

    def entry(i, j):
        return inverse[i, j] / (2 * snr) + pull[i] * pull[j] * wrong

    return entry(0, 0), entry(1, 1), entry(0, 1)


def _angle_deviations(xyz, covariance, points):
    """Deviations of azimuth and elevation in radians at the points."""
    along_u, along_w, both = covariance
    distance = jnp.maximum(jnp.linalg.norm(xyz, axis=-1), 1e-6)
    ground = jnp.maximum(jnp.linalg.norm(xyz[..., :2], axis=-1), 1e-6)
    cosine, w = ground / distance, xyz[..., 2] / distance
    sine = xyz[..., 1] / ground
    across = jnp.maximum(jnp.abs(xyz[..., 0]) / ground, 1e-3)
    lean = sine * w / cosine  # change of the azimuth's sine by w, times the cosine
    level = jnp.where(jnp.isfinite(along_w), along_w, 0.0)
    variance = along_u + 2 * lean * both + lean**2 * level
    azimuth = jnp.sqrt(variance) / (cosine * across)
    return azimuth, jnp.sqrt(along_w) / cosine
