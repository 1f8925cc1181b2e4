"""Several targets of one cell by Capon or MUSIC, each with its own elevation.

    azimuth     the highest maxima of the pseudo-spectrum of the longest row
    amplitude   in each row of the array, the sum of plane waves from these azimuths
                that is nearest to the snapshot (least squares)
    elevation   the phases between rows of what the other waves leave

The other targets are subtracted, because a beam towards one of them still receives the
rest, and their phases would shift its elevation.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import elevation_sines
from jradar.radar.angle.spectrum import WEAKEST, Peaks, angles_of_sines
from jradar.radar.angle.subspace import (
    NUM_AZIMUTH,
    SOURCES,
    capon_spectrum,
    in_blocks,
    music_spectrum,
    spectrum_maxima,
)
from jradar.radar.channels import check_antennas
from jradar.radar.ranks import to_rank

METHODS = ("capon", "music")
DAMPING = 1e-4  # of the least squares, relative to a row's number of antennas


@jit(static_argnames=("radar", "method", "count", "num_sources"))
def subspace_peaks(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    method: str,
    count: int = 2,
    num_sources: int = SOURCES,
) -> Peaks:
    """Return up to `count` targets of each snapshot, strongest first.

    `method` is "capon" or "music". Power is that of a target's plane wave. A peak is
    `valid` if its power is at most 6 dB below the strongest one's; with Capon, so must
    be its height in the spectrum; with MUSIC, at most `num_sources` are. Raises
    ValueError for another method or count, and as `music_spectrum`.
    """
    if method not in METHODS:
        raise ValueError(f"{method=}, expected one of {METHODS}")
    if not 1 <= count <= NUM_AZIMUTH:
        raise ValueError(f"{count=}, expected 1 to {NUM_AZIMUTH} targets")
    check_antennas(snapshot.shape, radar)

    def peaks_of(cell):
        most = count
        if method == "capon":
            spectrum = capon_spectrum(cell[None], radar, num_azimuth=NUM_AZIMUTH)
        else:
            spectrum = music_spectrum(cell[None], radar, num_sources=num_sources)
            most = num_sources
        u, height = spectrum_maxima(spectrum, radar, count)
        known = (height > 0) & (np.arange(count) < most)
        if method == "capon":
            known &= height >= WEAKEST * height[:1]
        known = known.at[0].set(True)
        waves = _plane_waves(cell, u, known, radar)
        power = (waves.real**2 + waves.imag**2).mean(-1)
        alone = (cell - waves.sum(0))[None] + waves
        return u, elevation_sines(alone, u, radar), power, known

    u, w, power, known = in_blocks(peaks_of, snapshot, radar)
    power, order = jax.lax.top_k(jnp.where(known, power, 0.0), count)
    u, w = (jnp.take_along_axis(sine, order, -1) for sine in (u, w))
    azimuth, elevation = angles_of_sines(u, w)
    valid = (power > 0) & (power >= WEAKEST * power[..., :1])
    return Peaks(azimuth, elevation, power, valid)


def _plane_waves(cell, u, known, radar):
    """The parts of a snapshot from each azimuth sine, row by row, `[peak virtual]`."""
    columns, rows = radar.virtual_positions.T
    member = (rows == np.unique(rows)[:, None]).astype(np.float32)  # [row, virtual]
    size = member.sum(1)
    turn = 2 * np.pi * radar.spacing_wavelengths * columns
    steering = jnp.exp(1j * u[:, None] * to_rank(turn, u[:, None]))
    steering = jnp.where(known[:, None], steering, 0.0).astype(cell.dtype)
    ours = member[:, None] * steering[None]  # [row, peak, virtual]
    normal = ours.conj() @ steering.T[None]
    normal += DAMPING * size[:, None, None] * np.eye(len(u), dtype=np.float32)[None]
    amplitude = jnp.linalg.solve(normal, (ours.conj() @ cell)[..., None])
    return (ours * amplitude).sum(0)
