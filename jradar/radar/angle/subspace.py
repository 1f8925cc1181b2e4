"""Azimuth of targets closer than a beam width: Capon (MVDR) and MUSIC.

Both use the covariance of the longest row of neighbouring elements. Echoes of one frame
are coherent, which would merge them into one source. The row is therefore cut into
overlapping subarrays whose covariances are averaged, both forwards and, because the row
is symmetric, conjugated and backwards (Pillai & Kwon 1989):

    row        o o o o o o o o
    subarrays  |-------|
                 |-------| ...    `subarray` elements each

A cell may have several snapshots (frames, chirps or neighbouring cells); a single one
is `snapshot[..., None, :]`. The pseudo-spectra lie on the sines u of `direction_sines`.
Their peaks are at the targets, but the heights of the peaks are not powers. For
`spectrum_peaks`, pass them as one row: `pseudo[..., None, :]`.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import elevation_sines
from jradar.radar.angle.spectrum import (
    NEARLY_ONE,
    Angle,
    angles_of_sines,
    direction_sines,
)
from jradar.radar.channels import check_antennas
from jradar.radar.peaks import parabola_offset
from jradar.radar.ranks import to_rank

BLOCK = 512  # cells whose spectra are held in memory at a time
SOURCES, NUM_AZIMUTH = 2, 256  # of the directions
LOADING = 1e-3  # of the diagonal of R in Capon's spectrum, in units of its mean
NOISE = 1e-6  # is added to the share in the noise subspace, and limits MUSIC's peaks


@jit(static_argnames=("radar", "num_azimuth"))
def capon_spectrum(
    snapshot: Complex[Array, "*batch snapshot virtual"],
    radar: RadarSpec,
    *,
    num_azimuth: int = NUM_AZIMUTH,
) -> Float[Array, "*batch azimuth"]:
    """Return 1 / (a^H R^-1 a): the power of the minimum-variance beam (Capon 1969)."""
    covariance = smoothed_covariance(snapshot, radar)
    size = covariance.shape[-1]
    level = _mean_power(covariance)
    loaded = covariance / level + to_rank(LOADING * np.eye(size), covariance)
    factor = jnp.linalg.cholesky(loaded)
    steering = _steering(radar, size, num_azimuth)
    steering = steering.astype(factor.dtype)
    steering = jnp.broadcast_to(steering, (*factor.shape[:-1], num_azimuth))
    whitened = jax.lax.linalg.triangular_solve(
        factor, steering, left_side=True, lower=True
    )
    inverse = (whitened.real**2 + whitened.imag**2).sum(-2)
    return level[..., 0] / inverse


@jit(static_argnames=("radar", "num_azimuth", "num_sources"))
def music_spectrum(
    snapshot: Complex[Array, "*batch snapshot virtual"],
    radar: RadarSpec,
    *,
    num_sources: int,
    num_azimuth: int = NUM_AZIMUTH,
) -> Float[Array, "*batch azimuth"]:
    """Return 1 / (share of the steering vector in the noise subspace) (Schmidt 1986).

    The share is 1 away from targets. Raises ValueError unless the subarray is longer
    than `num_sources`.
    """
    covariance = smoothed_covariance(snapshot, radar)
    size = covariance.shape[-1]
    if not 1 <= num_sources <= size - 1:
        raise ValueError(
            f"{num_sources=}, expected 1 to {size - 1}: a subarray of {size} elements "
            "needs one more than there are sources"
        )
    projector = _signal_projector(covariance / _mean_power(covariance), num_sources)
    steering = to_rank(_steering(radar, size, num_azimuth), projector)
    noise = steering - projector @ steering
    share = (noise.real**2 + noise.imag**2).sum(-2) / size
    return 1 / (share + NOISE)


@jit(static_argnames=("radar", "method", "num_sources"))
def subspace_directions(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    method: str,
    num_sources: int = SOURCES,
) -> tuple[Angle, Angle]:
    """Return azimuth and elevation in radians of each snapshot by "capon" or "music".

    With Capon, the azimuth is the highest maximum of the spectrum. With MUSIC, whose
    heights are not powers, it is the maximum at which the conventional beam is
    strongest. The elevation follows from the phases between the rows' beams towards
    that azimuth. A second target in such a beam shifts it: see `subspace_peaks`.
    """

    def strongest(cell):
        if method == "capon":
            return spectrum_maxima(capon_spectrum(cell[None], radar), radar, 1)[0][0]
        spectrum = music_spectrum(cell[None], radar, num_sources=num_sources)
        row = jnp.asarray(_longest_row(radar)) @ cell
        beam = jnp.abs(_steering(radar, len(row), NUM_AZIMUTH).conj().T @ row)
        return spectrum_maxima(spectrum, radar, 1, rank=beam)[0][0]

    u = in_blocks(strongest, snapshot, radar)
    return angles_of_sines(u, elevation_sines(snapshot, u, radar))


def in_blocks(function: Callable, snapshot: Array, radar: RadarSpec) -> Any:
    """Apply a function of one snapshot to all, a block at a time."""
    cells = snapshot.reshape(-1, radar.num_virtual)
    size = min(BLOCK, max(len(cells), 1))
    found = jax.lax.map(function, cells, batch_size=size)
    batch = snapshot.shape[:-1]
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), found)


def spectrum_maxima(
    spectrum: Float[Array, " azimuth"],
    radar: RadarSpec,
    count: int,
    *,
    rank: Float[Array, " azimuth"] | None = None,
) -> tuple[Float[Array, " peak"], Float[Array, " peak"]]:
    """Return the sines, between bins, and ranks of the maxima of one spectrum.

    They are the `count` with the highest `rank`, by default the spectrum itself. A rank
    of -1 means that there is no maximum.
    """
    u, _ = direction_sines(radar, num_azimuth=len(spectrum))
    left, right = jnp.roll(spectrum, 1), jnp.roll(spectrum, -1)
    peak = (spectrum > left) & (spectrum >= right) & (np.abs(u) < 1)
    rank = jnp.where(peak, spectrum if rank is None else rank, -1.0)
    height, index = jax.lax.top_k(rank, count)
    offset = parabola_offset(left[index], spectrum[index], right[index])
    sine = jnp.asarray(u, jnp.float32)[index] + offset * (u[1] - u[0])
    return jnp.clip(sine, -NEARLY_ONE, NEARLY_ONE), height


@jit(static_argnames="radar")
def smoothed_covariance(
    snapshot: Complex[Array, "*batch snapshot virtual"], radar: RadarSpec
) -> Complex[Array, "*batch element element"]:
    """Return a subarray's covariance: mean over snapshots, places, both directions.

    A subarray has two thirds of the row's elements. Raises ValueError for an array
    without neighbouring elements.
    """
    check_antennas(snapshot.shape, radar)
    average = _longest_row(radar)
    length = len(average)
    size = max(2, round(2 * length / 3))
    if length < 2:
        raise ValueError(
            f"Capon and MUSIC need neighbouring elements in a row, {radar.name} has "
            "none: use angles by FFT"
        )
    row = snapshot @ average.T
    window = np.arange(length - size + 1)[:, None] + np.arange(size)
    places = row[..., window]  # [*batch, snapshot, place, element]
    places = places.reshape(*row.shape[:-2], -1, size)
    forward = jnp.einsum("...pi,...pj->...ij", places, places.conj())
    forward = forward / places.shape[-2]
    return (forward + forward[..., ::-1, ::-1].conj()) / 2


def _longest_row(radar):
    """Matrix that averages antennas into the longest run, `[element, virtual]`."""
    columns, rows = radar.virtual_positions.T
    runs = []
    for row in np.unique(rows):
        held = np.unique(columns[rows == row])
        gaps = np.flatnonzero(np.diff(held) > 1) + 1
        runs += [(run, row) for run in np.split(held, gaps)]
    run, row = max(runs, key=lambda pair: len(pair[0]))
    member = (columns == run[:, None]) & (rows == row)
    return (member / member.sum(1, keepdims=True)).astype(np.complex64)


def _steering(radar, size, num_azimuth):
    """Response of `size` neighbours to every azimuth bin, `[element, azimuth]`."""
    u, _ = direction_sines(radar, num_azimuth=num_azimuth)
    phase = 2 * np.pi * radar.spacing_wavelengths * np.outer(np.arange(size), u)
    return jnp.asarray(np.exp(1j * phase), jnp.complex64)


def _mean_power(covariance):
    """Mean of the diagonal, `[*batch, 1, 1]`; 1 if it is 0."""
    level = jnp.trace(covariance, axis1=-2, axis2=-1).real / covariance.shape[-1]
    return jnp.where(level > 0, level, 1.0)[..., None, None]


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _signal_projector(covariance, num_sources):
    """Projector on the eigenvectors of the `num_sources` largest eigenvalues."""
    _, vectors = jnp.linalg.eigh(covariance)
    signal = vectors[..., -num_sources:]  # of the largest eigenvalues
    return signal @ signal.conj().mT


@_signal_projector.defjvp
def _signal_projector_jvp(num_sources, primals, tangents):
    """A sum over pairs (noise, signal), finite where noise eigenvalues are equal."""
    (covariance,), (change,) = primals, tangents
    values, vectors = jnp.linalg.eigh(covariance)
    signal = np.arange(covariance.shape[-1]) >= covariance.shape[-1] - num_sources
    pair = to_rank(~signal[:, None] & signal, covariance)
    gap = values[..., None, :] - values[..., :, None]
    coupling = vectors.conj().mT @ change @ vectors
    coupling = jnp.where(pair, coupling / jnp.maximum(gap, 1e-6), 0.0)
    half = vectors @ coupling @ vectors.conj().mT
    signal = vectors[..., -num_sources:]
    return signal @ signal.conj().mT, half + half.conj().mT
