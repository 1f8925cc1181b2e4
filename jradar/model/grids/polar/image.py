"""The polar image of one frame, formed as RadarHD forms it (Prabhakara et al. 2023).

    first chirp of each transmitter, one row of antennas      [antenna, sample]
    -> spectrum over samples and antennas, magnitudes         64 azimuths x 512 ranges
    -> cells of at least 1/20 of the strongest; else empty
    -> dB, from 0 (weakest) to 1 (strongest) of those in view
    -> pixels of even angles                                  256 ranges x 64 azimuths

There is no window and no mean over chirps, and echoes at rest are not removed. A cell
goes to the first pixel at or beyond its range and at or to the left of its azimuth. If
two cells share a pixel, the cell of larger range replaces the other; at the same range,
the cell farther to the right does. So the stronger cell can be lost. Pixels without a
cell stay empty.

Spectra are computed at the ranges and directions of RadarHD's cells, whatever chirp and
spacing of antennas the radar has; of RadarHD's radar, they are plain FFTs.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Inexact, Int

from jradar.compiled import jit
from jradar.model.grids.polar.axes import MAX_RANGE_M, RADAR, VIEW_M
from jradar.options.suiting import azimuth_row
from jradar.radar import RadarSpec

CELLS = 64, 512  # azimuths and ranges of the spectrum
FARTHEST_M = 21.59  # range that RadarHD gives to the last cell
FIRST_BIN = 6  # nearer cells hold the leakage
LEAST = 0.05  # magnitude of a cell, relative to the strongest
VIEW_DEGREES = 70.0  # to either side
BANDS = 8  # of ranges, whose features show how unlike training an image is

RADARHD = (
    RadarSpec(  # one row of the AWR1843, with the waveform of `radarhd_config.xml`
        name="radarhd",
        start_frequency_hz=77e9,
        slope_hz_per_s=63.343e12,
        sample_rate_hz=9.121e6,
        num_samples=512,
        num_chirps=64,
        idle_time_s=10e-6,
        adc_start_time_s=6e-6,
        ramp_end_time_s=63.14e-6,
        tx_positions=((0, 0), (4, 0)),
        rx_positions=((0, 0), (1, 0), (2, 0), (3, 0)),
        design_frequency_hz=76.8e9,
        frame_period_s=0.05,
    )
)


@jit
def image_features(
    image: Float[Array, "*batch range azimuth"],
) -> Float[Array, "*batch feature"]:
    """Return the share of lit pixels and their mean value in each band of ranges.

    They show how unlike training an image is: see `jradar.range_image.unlikeness`.
    """
    parts = image.reshape(*image.shape[:-2], BANDS, -1)
    lit = (parts > 0).sum(-1)
    mean = parts.sum(-1) / jnp.maximum(lit, 1)
    return jnp.concatenate([jnp.sqrt(lit / parts.shape[-1]), mean], -1)


@jit(static_argnames="radar")
def polar_image(
    samples: Inexact[Array, "tx rx chirp sample"], radar: RadarSpec
) -> Float[Array, "range azimuth"]:
    """Return the polar image of one frame's calibrated samples, 0 to 1 in 255 steps.

    It is on the grid `RADAR`. One frame; `vmap` it. Raises UsageError for a radar
    without two neighbouring antennas in a row.
    """
    antennas, _ = azimuth_row(radar)
    first = samples.reshape(radar.num_virtual, radar.num_chirps, -1)[antennas, 0]
    over_samples, over_antennas = _transforms(radar)
    exactly = jax.lax.Precision.HIGHEST
    spectrum = jnp.einsum(
        "am,ms,sr->ar", over_antennas, first, over_samples, precision=exactly
    )
    magnitude = jnp.abs(spectrum)
    magnitude = jnp.where(_usable(radar), magnitude, 0.0)
    strong = (magnitude >= LEAST * magnitude.max()) & (magnitude > 0)
    level = jnp.where(strong, 10 * jnp.log10(magnitude), -jnp.inf).ravel()
    level = jnp.append(level, -jnp.inf)  # of the pixels without a cell
    earlier, later = level[_cells_of_pixels()]
    image = jnp.where(later > -jnp.inf, later, earlier)
    seen = image > -jnp.inf
    either = jnp.stack([earlier, later])
    low = jnp.where(either > -jnp.inf, either, jnp.inf).min()
    span = either.max() - low
    shade = jnp.floor(255 * (image - low) / jnp.where(span > 0, span, 1.0)) / 255
    return jnp.where(seen & (span > 0), shade, 0.0)


def _usable(radar: RadarSpec) -> Bool[np.ndarray, " range"]:
    """Return which ranges of the spectrum are free of leakage and of other periods."""
    cells = np.arange(CELLS[1])
    end = radar.max_range_m / RADARHD.range_resolution_m
    if radar.max_range_m < MAX_RANGE_M:  # its leakage is in view at the far end, too
        end -= FIRST_BIN
    return (cells >= FIRST_BIN) & (cells < end)


def _transforms(radar: RadarSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return the transforms over samples and over antennas, to RadarHD's cells."""
    _, columns = azimuth_row(radar)
    num_azimuth, num_range = CELLS
    finer = RADARHD.range_resolution_m / radar.range_resolution_m
    bins = np.arange(num_range) * finer / radar.num_samples  # periods in a sample
    wider = radar.spacing_wavelengths / RADARHD.spacing_wavelengths
    # The first azimuth is that to the left.
    turns = (num_azimuth // 2 - np.arange(num_azimuth)) * wider / num_azimuth
    over_samples = np.exp(-2j * np.pi * np.outer(np.arange(radar.num_samples), bins))
    over_antennas = np.exp(-2j * np.pi * np.outer(turns, columns - columns[0]))
    return over_samples.astype(np.complex64), over_antennas.astype(np.complex64)


@functools.cache
def _cells_of_pixels() -> Int[np.ndarray, "two range azimuth"]:
    """Return the last two cells of each pixel; the second one replaces the first.

    The number of all cells stands for no cell.
    """
    num_azimuth, num_range = CELLS
    sine = np.linspace(1, -1, num_azimuth)[:, None]
    distance = np.linspace(0, FARTHEST_M, num_range)
    ahead, left = distance * np.sqrt(1 - sine**2), distance * sine
    azimuth = np.degrees(np.arctan2(left, ahead))
    seen = (ahead > 0) & (ahead <= VIEW_M) & (abs(left) <= VIEW_M)
    seen &= (abs(azimuth) <= VIEW_DEGREES) & (np.hypot(ahead, left) <= MAX_RANGE_M)
    seen[:, :FIRST_BIN] = False
    azimuths, ranges = np.nonzero(seen)  # azimuth by azimuth, from the left
    row = np.searchsorted(RADAR.ranges, np.hypot(ahead, left)[seen])
    column = np.searchsorted(np.degrees(RADAR.angles), azimuth[seen])
    found = np.full((2, *RADAR.shape), num_azimuth * num_range)
    for cell, *pixel in zip(azimuths * num_range + ranges, row, column, strict=True):
        place = tuple(pixel)
        found[(0, *place)], found[(1, *place)] = found[(1, *place)], cell
    return found
