"""Azimuth of targets closer than a beam width: Capon (MVDR) and MUSIC.

Both look at the covariance of the array's longest row of neighbouring elements. Echoes
of one frame are coherent, which would merge them into one source; so the row is cut
into overlapping subarrays whose covariances are averaged, forwards and, as the row is
symmetric, conjugated backwards (Pillai & Kwon 1989):

    row        o o o o o o o o
    subarrays  |-------|
                 |-------| ...    `subarray` elements each

Cells may have several snapshots (frames, chirps or neighbouring cells); a single one is
`snapshot[..., None, :]`. The pseudo-spectra lie on the sines u of `direction_sines`:
peaks stand where targets are, their heights are no powers of targets. As one row,
`pseudo[..., None, :]`, they go into `spectrum_peaks`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.radar.angle import (
    FLIPS,
    NEARLY_ONE,
    Angle,
    angles_of_sines,
    direction_sines,
)
from jradar.radar.direction import elevation_sines
from jradar.radar.peaks import parabola_offset
from jradar.radar.sensor import RadarSpec

BLOCK = 512  # cells whose spectra are held at a time
OPTIONS = ("radar", "num_azimuth", "subarray", "loading")


@functools.partial(jax.jit, static_argnames=OPTIONS)
def capon_spectrum(
    snapshot: Complex[Array, "*batch snapshot virtual"],
    radar: RadarSpec,
    *,
    num_azimuth: int = 256,
    subarray: int | None = None,
    loading: float = 1e-3,
) -> Float[Array, "*batch azimuth"]:
    """Power 1 / (a^H R^-1 a) of the beam that passes u and least of all else.

    Capon (1969). `subarray` elements, by default two thirds of the row; `loading` is
    added to R's diagonal in units of its mean. Raises ValueError where the subarray
    does not fit in the row.
    """
    covariance = smoothed_covariance(snapshot, radar, subarray=subarray)
    size = covariance.shape[-1]
    level = _mean_power(covariance)
    loaded = covariance / level + loading * jnp.eye(size)
    factor = jnp.linalg.cholesky(loaded)
    steering = jnp.broadcast_to(
        _steering(radar, size, num_azimuth), (*factor.shape[:-1], num_azimuth)
    )
    whitened = jax.lax.linalg.triangular_solve(
        factor, steering, left_side=True, lower=True
    )
    inverse = (whitened.real**2 + whitened.imag**2).sum(-2)
    return level[..., 0] / inverse


@functools.partial(jax.jit, static_argnames=(*OPTIONS, "num_sources"))
def music_spectrum(
    snapshot: Complex[Array, "*batch snapshot virtual"],
    radar: RadarSpec,
    *,
    num_sources: int,
    num_azimuth: int = 256,
    subarray: int | None = None,
    loading: float = 1e-6,
) -> Float[Array, "*batch azimuth"]:
    """Reciprocal of the steering vector's share that lies in the noise subspace.

    Schmidt (1986). 1 where no target is; `loading` is the share where it ends growing.
    Raises ValueError where the subarray does not fit in the row, or is not longer than
    `num_sources`.
    """
    covariance = smoothed_covariance(snapshot, radar, subarray=subarray)
    size = covariance.shape[-1]
    if not 1 <= num_sources <= size - 1:
        raise ValueError(
            f"{num_sources=}, expected 1 to {size - 1}: a subarray of {size} elements "
            "needs one more than there are sources"
        )
    projector = _signal_projector(covariance / _mean_power(covariance), num_sources)
    steering = _steering(radar, size, num_azimuth)
    noise = steering - projector @ steering
    share = (noise.real**2 + noise.imag**2).sum(-2) / size
    return 1 / (share + loading)


@functools.partial(
    jax.jit, static_argnames=("radar", "num_sources", "num_azimuth", *FLIPS)
)
def music_directions(
    snapshot: Complex[Array, "*batch virtual"],
    radar: RadarSpec,
    *,
    num_sources: int = 2,
    num_azimuth: int = 256,
    flip_azimuth: bool = False,
    flip_elevation: bool = False,
) -> tuple[Angle, Angle]:
    """Azimuth and elevation in radians of each cell, the azimuth by MUSIC.

    Of the maxima of `music_spectrum`, whose heights are no powers, the one where the
    row's plain beam is strongest. The elevation is the strongest there. One snapshot
    for each cell.
    """
    cells = snapshot.reshape(-1, radar.num_virtual)
    u = jax.lax.map(
        lambda cell: _music_sine(cell, radar, num_sources, num_azimuth),
        cells,
        batch_size=min(BLOCK, max(len(cells), 1)),
    ).reshape(snapshot.shape[:-1])
    w = elevation_sines(snapshot, u, radar)
    return angles_of_sines(u, w, flip_azimuth, flip_elevation)


def _music_sine(cell, radar, num_sources, num_azimuth):
    """Azimuth sine of one cell `[virtual]`, placed between the spectrum's bins."""
    pseudo = music_spectrum(
        cell[None], radar, num_sources=num_sources, num_azimuth=num_azimuth
    )
    average = jnp.asarray(_longest_row(radar))
    row = average @ cell
    beam = jnp.abs(_steering(radar, len(row), num_azimuth).conj().T @ row)
    u, _ = direction_sines(radar, num_azimuth=num_azimuth)
    left, right = jnp.roll(pseudo, 1), jnp.roll(pseudo, -1)
    peak = (pseudo > left) & (pseudo >= right) & (np.abs(u) < 1)
    index = jnp.argmax(jnp.where(peak, beam, -1.0))
    offset = parabola_offset(left[index], pseudo[index], right[index])
    sine = jnp.asarray(u, jnp.float32)[index] + offset * (u[1] - u[0])
    return jnp.clip(sine, -NEARLY_ONE, NEARLY_ONE)


@functools.partial(jax.jit, static_argnames=("radar", "subarray"))
def smoothed_covariance(
    snapshot: Complex[Array, "*batch snapshot virtual"],
    radar: RadarSpec,
    *,
    subarray: int | None = None,
) -> Complex[Array, "*batch element element"]:
    """Covariance of a subarray: mean over snapshots, places and both directions."""
    if snapshot.shape[-1] != radar.num_virtual:
        raise ValueError(
            f"{snapshot.shape[-1]} values per snapshot, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    average = _longest_row(radar)
    length = len(average)
    size = max(2, round(2 * length / 3)) if subarray is None else subarray
    if not 2 <= size <= length:
        raise ValueError(
            f"subarray={size}, expected 2 to {length}, the neighbouring elements in "
            f"the longest row of {radar.name}"
        )
    row = snapshot @ average.T
    window = np.arange(length - size + 1)[:, None] + np.arange(size)
    places = row[..., window]  # [*batch, snapshot, place, element]
    places = places.reshape(*row.shape[:-2], -1, size)
    forward = jnp.einsum("...pi,...pj->...ij", places, places.conj())
    forward = forward / places.shape[-2]
    return (forward + forward[..., ::-1, ::-1].conj()) / 2


def _longest_row(radar: RadarSpec) -> np.ndarray:
    """Averages of antennas to the longest run of neighbours, `[element, virtual]`."""
    columns, rows = radar.virtual_positions.T
    runs = []
    for row in np.unique(rows):
        held = np.unique(columns[rows == row])
        runs += [
            (run, row) for run in np.split(held, np.flatnonzero(np.diff(held) > 1) + 1)
        ]
    run, row = max(runs, key=lambda pair: len(pair[0]))
    member = (columns == run[:, None]) & (rows == row)
    return (member / member.sum(1, keepdims=True)).astype(np.complex64)


def _steering(radar: RadarSpec, size: int, num_azimuth: int) -> Array:
    """Response of `size` neighbours to every azimuth bin, `[element, azimuth]`."""
    u, _ = direction_sines(radar, num_azimuth=num_azimuth)
    phase = 2 * np.pi * radar.spacing_wavelengths * np.outer(np.arange(size), u)
    return jnp.asarray(np.exp(1j * phase), jnp.complex64)


def _mean_power(covariance: Complex[Array, "*batch element element"]) -> Array:
    """Mean of the diagonal, `[*batch, 1, 1]`; 1 where all is zero."""
    level = jnp.trace(covariance, axis1=-2, axis2=-1).real / covariance.shape[-1]
    return jnp.where(level > 0, level, 1.0)[..., None, None]


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def _signal_projector(
    covariance: Complex[Array, "*batch element element"], num_sources: int
) -> Complex[Array, "*batch element element"]:
    """Projector on the eigenvectors of the `num_sources` largest eigenvalues.

    Its derivative needs the gap between signal and noise only; that of single
    eigenvectors would be infinite wherever two noise eigenvalues are equal.
    """
    _, vectors = jnp.linalg.eigh(covariance)
    signal = vectors[..., -num_sources:]
    return signal @ signal.conj().mT


@_signal_projector.defjvp
def _signal_projector_jvp(num_sources, primals, tangents):
    """First-order perturbation of a projector, sum over pairs (signal, noise)."""
    (covariance,), (change,) = primals, tangents
    values, vectors = jnp.linalg.eigh(covariance)
    noise, signal = vectors[..., :-num_sources], vectors[..., -num_sources:]
    gap = values[..., None, -num_sources:] - values[..., :-num_sources, None]
    coupling = noise.conj().mT @ change @ signal / jnp.maximum(gap, 1e-6)
    half = noise @ coupling @ signal.conj().mT
    return signal @ signal.conj().mT, half + half.conj().mT
