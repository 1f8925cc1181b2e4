"""Channel factors from the echoes of a scene, without a reflector of known place.

The snapshot of a single echo e at virtual antenna v is

    x[e, v] = s[e] g[v] exp(2 pi j (d_c a[v] u[e] + d_r r[v] w[e])) + noise

with the echo's amplitude s and direction sines (u, w), and the channel's response g.
Alternating least squares (the gain and phase errors of Friedlander & Weiss 1991, for
one source in each snapshot) fits in turn

    u, w, s of each echo, given g          the peak of its angle spectrum
    g, given u, w, s of all echoes         a weighted mean; tx times rx: rank one

Echoes that one direction does not explain, because their cell holds several echoes,
lose their weight (Geman & McClure 1987).

One part cannot be observed: a response whose phase grows linearly along columns or rows
shifts every echo by the same amount in u or w, which nothing in the snapshots
contradicts. On an AWR1843, the phase of the upper row's transmitter is such a tilt. So
the estimate's phase has no linear part, unless a reflector shows it, and no common
factor.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from jradar.calibration.snapshots import Snapshots
from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import directions
from jradar.radar.angle.spectrum import azimuth_bins
from jradar.radar.ranks import to_rank

FINEST, FINER = 256, 2  # azimuth bins, or this many per bin of `azimuth_bins`
NUM_ELEVATION = 64
MOST_STEPS, CONVERGED = 200, 1e-5
MIN_ECHOES = 5  # in each half
BEST = 0.25  # share of the strong cells that surely hold a single echo
BLOCK = 4  # range bins that stay together when echoes are halved
TOLERANCE_M = 0.3  # by which a reflector's measured range may be wrong
SIMPLER = 1.05  # residual for which a factor per antenna replaces one per pair
LARGEST_DB = 20.0  # by which a working channel differs from the others
TINY = 1e-30


class Explained(NamedTuple):
    """Snapshots as single echoes, given the response of the channels."""

    azimuth: Float[Array, " echo"]  # radians
    elevation: Float[Array, " echo"]
    model: Complex[Array, "echo virtual"]  # the best single echo
    residual: Float[Array, " echo"]  # share of the power that it does not explain


class Residuals(NamedTuple):
    """How well single directions explain echoes: the best quarter of them, and all."""

    phase_deg: float  # first quartile of the root mean square over the antennas
    power_share: float  # first quartile of the share that is not explained
    peak_to_mean: float  # of the angle spectrum, mean over all echoes


class SelfCalibration(NamedTuple):
    """Factors that undo the channels' response, and what they improve.

    The residuals are those of echoes that were left out: one half of the range bins is
    fitted, the other one measured, and the other way round.
    """

    factors: Complex[np.ndarray, " virtual"]  # by which to multiply the channels
    improves: bool  # echoes left out; otherwise the channels stay as they are
    separable: bool  # a factor of the transmitter times one of the receiver
    echoes: int
    azimuth_spread_deg: float  # of the echoes, standard deviation
    before: Residuals
    after: Residuals
    uncertainty_deg: float  # of the factors' phases, from the fits to the halves
    range_bias_m: float | None = None  # None without a reflector


def self_calibrate(
    echoes: Snapshots,
    radar: RadarSpec,
    *,
    reflector: tuple[float, float, float] | None = None,
) -> SelfCalibration:
    """Return the factors of the channels from the echoes `[frame, echo]`; host.

    `reflector` is the range in metres, azimuth and elevation in radians of a corner
    reflector that stands still. Without it the factors' phases have no linear part.
    Echoes that are not finite are left out. Raises ValueError for an array that shows
    nothing, fewer than 5 echoes in either half of the range bins, a channel that is
    20 dB off, and a reflector that is not found.
    """
    _check_observable(radar)
    echoes = _finite(echoes)
    snapshot = np.asarray(echoes.snapshot).reshape(-1, radar.num_virtual)
    heard = np.asarray(echoes.power).ravel() > 0
    halves = _halves(snapshot, np.asarray(echoes.range_m).ravel(), heard, radar)
    unchanged = np.ones(radar.num_virtual, np.complex64)
    before = residuals(halves[::-1], [unchanged] * 2, radar)
    fits = {
        separable: [
            channel_response(half, radar, separable=separable) for half in halves
        ]
        for separable in (True, False)
    }
    checks = {s: residuals(halves[::-1], fit, radar) for s, fit in fits.items()}
    separable = checks[True].power_share <= SIMPLER * checks[False].power_share
    after = checks[separable]
    improves = after.power_share < before.power_share
    response = jnp.asarray(unchanged)
    if improves:
        response = channel_response(snapshot, radar, separable=separable)
        _check_gains(response, radar)
    one, other = map(np.asarray, fits[separable])
    apart = np.angle(one / other)
    bias = None
    if reflector is not None:
        response, bias = towards_reflector(response, echoes, radar, reflector)
    azimuth = np.asarray(explain(snapshot, response, radar).azimuth)[heard]
    return SelfCalibration(
        factors=np.asarray(1 / response),
        improves=improves,
        separable=separable,
        echoes=int(heard.sum()),
        azimuth_spread_deg=float(np.degrees(azimuth.std())),
        before=before,
        after=after,
        uncertainty_deg=float(np.degrees(np.sqrt((apart**2).mean())) / 2),
        range_bias_m=bias,
    )


def _finite(echoes: Snapshots) -> Snapshots:
    """The echoes; those with values that are not finite become padding."""
    snapshot, range_m, power = (
        np.asarray(values) for values in (echoes.snapshot, echoes.range_m, echoes.power)
    )
    finite = np.isfinite(snapshot).all(-1) & np.isfinite(range_m) & np.isfinite(power)
    return echoes._replace(
        snapshot=np.where(finite[..., None], snapshot, 0),
        range_m=np.where(finite, range_m, 0),
        power=np.where(finite, power, 0),
    )


def residuals(
    snapshots: Sequence[np.ndarray],
    responses: Sequence[Array | np.ndarray],
    radar: RadarSpec,
) -> Residuals:
    """Return the residuals of groups of snapshots, each with a response; host."""
    phases, shares = [], []
    for snapshot, response in zip(snapshots, responses, strict=True):
        heard = np.abs(snapshot).any(1)
        found = explain(snapshot, response, radar)
        model = np.asarray(found.model)[heard]
        error = np.angle(snapshot[heard] * model.conj())
        weight = np.abs(model) ** 2
        phases.append(np.sqrt((weight * error**2).sum(1) / weight.sum(1)))
        shares.append(np.asarray(found.residual)[heard])
    phase, share = np.concatenate(phases), np.concatenate(shares)
    return Residuals(
        phase_deg=float(np.degrees(np.quantile(phase, BEST))),
        power_share=float(np.quantile(share, BEST)),
        peak_to_mean=float(radar.num_virtual * (1 - share.mean())),
    )


@jit(static_argnames="radar")
def explain(
    snapshot: Complex[Array | np.ndarray, "echo virtual"],
    response: Complex[Array | np.ndarray, " virtual"],
    radar: RadarSpec,
) -> Explained:
    """Return the single echo that is nearest to each snapshot, in least squares."""
    azimuth, elevation = directions(
        jnp.asarray(snapshot) * response.conj()[None],
        radar,
        num_azimuth=max(FINEST, FINER * azimuth_bins(radar)),
        num_elevation=NUM_ELEVATION,
    )
    wave = response[None] * steering(azimuth, elevation, radar)
    amplitude = (wave.conj() * snapshot).sum(-1) / (jnp.abs(response) ** 2).sum()
    model = amplitude[:, None] * wave
    missed = (jnp.abs(snapshot - model) ** 2).sum(-1)
    total = (jnp.abs(snapshot) ** 2).sum(-1)
    return Explained(azimuth, elevation, model, missed / jnp.maximum(total, TINY))


def steering(
    azimuth: Float[Array, "*batch"], elevation: Float[Array, "*batch"], radar: RadarSpec
) -> Complex[Array, "*batch virtual"]:
    """Return the phasors of a plane wave at the virtual antennas."""
    columns, rows = radar.virtual_positions.T
    u, w = jnp.sin(azimuth) * jnp.cos(elevation), jnp.sin(elevation)
    cycles = radar.spacing_wavelengths * u[..., None] * to_rank(columns, u[..., None])
    cycles += radar.row_spacing_wavelengths * w[..., None] * to_rank(rows, w[..., None])
    return jnp.exp(2j * jnp.pi * cycles)


@jit(static_argnames="radar")
def channel_response(
    snapshot: Complex[Array | np.ndarray, "echo virtual"],
    radar: RadarSpec,
    *,
    separable: bool | Bool[Array, ""],
) -> Complex[Array, " virtual"]:
    """Return the response g of each channel, by alternating least squares.

    Its phase has no linear part along columns and rows, its mean gain in dB is 0.
    `separable` makes it a factor of the transmitter times one of the receiver.
    Snapshots that are 0, or not finite, are padding.
    """
    power = (jnp.abs(snapshot) ** 2).sum(-1, keepdims=True)
    known = jnp.isfinite(power) & (power > 0)
    unit = jnp.where(known, snapshot / jnp.sqrt(jnp.where(known, power, 1.0)), 0.0)
    heard = known[:, 0]

    def step(state):
        before, _, steps = state
        found = explain(unit, before, radar)
        usual = jnp.nanquantile(jnp.where(heard, found.residual, jnp.nan), BEST)
        weight = heard / (1 + found.residual / jnp.maximum(usual, TINY)) ** 2
        wave = found.model / before[None]
        response = (weight[:, None] * wave.conj() * unit).sum(0)
        response /= (weight[:, None] * jnp.abs(wave) ** 2).sum(0)
        pairs = response.reshape(radar.num_tx, radar.num_rx)
        tx, values, rx = jnp.linalg.svd(pairs, full_matrices=False)
        nearest = (values[0] * tx[:, :1] * rx[:1]).ravel()
        response = jnp.where(separable, nearest, response)
        response = without_tilt(response, radar).astype(before.dtype)
        return response, jnp.abs(response - before).max(), steps + 1

    def goes_on(state):
        _, change, steps = state
        return (change > CONVERGED) & (steps < MOST_STEPS)

    start = jnp.ones(radar.num_virtual, snapshot.dtype)
    change = jnp.full((), jnp.inf, start.real.dtype)
    response, _, _ = jax.lax.while_loop(goes_on, step, (start, change, 0))
    return response


def without_tilt(
    response: Complex[Array, " virtual"], radar: RadarSpec
) -> Complex[Array, " virtual"]:
    """Remove what no snapshot shows: common factor, and linear part of the phase."""
    basis = linear_phases(radar).astype(np.float32)
    phase = jnp.angle(response)
    gain = jnp.log(jnp.maximum(jnp.abs(response), TINY))
    return jnp.exp(gain - gain.mean() + 1j * (phase - basis @ (basis.T @ phase)))


def linear_phases(radar: RadarSpec) -> Float[np.ndarray, "virtual part"]:
    """Return an orthonormal basis of the phases that are linear over the array; host.

    They are constant, or grow along columns or along rows.
    """
    positions = radar.virtual_positions
    parts = np.column_stack([np.ones(len(positions)), positions])
    basis, size, _ = np.linalg.svd(parts, full_matrices=False)
    return basis[:, size > 1e-9 * size[0]]


def _check_observable(radar: RadarSpec) -> None:
    """Raise ValueError if any phases of the channels are a tilt of the array."""
    count, hidden = linear_phases(radar).shape
    if count == hidden:
        raise ValueError(
            f"{radar.name} has {count} virtual antennas: any phases of theirs look "
            "like another direction of the echoes, expected a larger array"
        )


def towards_reflector(
    response: Complex[Array, " virtual"],
    echoes: Snapshots,
    radar: RadarSpec,
    reflector: tuple[float, float, float],
) -> tuple[Complex[Array, " virtual"], float]:
    """Return the response with the tilt that the reflector shows, and the range bias.

    `reflector` is as in `self_calibrate`. It is the strongest echo within 0.3 m, or two
    range bins, of its range that stands still. Raises ValueError unless at least half
    of the frames show it. Host.
    """
    expected_m, azimuth, elevation = reflector
    range_m, power = (
        np.atleast_2d(np.asarray(column)) for column in (echoes.range_m, echoes.power)
    )
    near = np.abs(range_m - expected_m) < max(TOLERANCE_M, 2 * radar.range_resolution_m)
    still = np.abs(np.asarray(echoes.velocity_mps)) < radar.velocity_resolution_mps
    power = np.where(near & still.reshape(power.shape), power, 0.0)
    strongest = power.argmax(1)
    frames = np.flatnonzero(power.max(1) > 0)
    if 2 * len(frames) < len(power):
        raise ValueError(
            f"the reflector at {expected_m:g} m is seen in {len(frames)} of "
            f"{len(power)} frames, expected half of them or more: is its range right, "
            "and do radar and reflector stand still?"
        )
    place = frames, strongest[frames]
    shape = (*power.shape, radar.num_virtual)
    seen = explain(np.asarray(echoes.snapshot).reshape(shape)[place], response, radar)
    wave = steering(seen.azimuth, seen.elevation, radar)
    true = steering(jnp.asarray(azimuth), jnp.asarray(elevation), radar)
    turn = wave * true.conj()[None]
    turn = turn.mean(0)
    bias = float(np.median(range_m[place])) - expected_m
    return response * turn / jnp.abs(turn), bias


def _halves(snapshot, range_m, heard, radar):
    """The snapshots of every other block of range bins, and those of the rest."""
    block = range_m // (BLOCK * radar.range_resolution_m)
    halves = [heard & (block % 2 == half) for half in (0, 1)]
    if (least := min(int(half.sum()) for half in halves)) < MIN_ECHOES:
        raise ValueError(
            f"{heard.sum()} strong echoes, {least} of them in one half of the range "
            f"bins, expected {MIN_ECHOES} or more in each: use more frames, or record "
            "a scene with single objects at several ranges and angles"
        )
    return [np.where(half[:, None], snapshot, 0) for half in halves]


def _check_gains(response, radar):
    """Raise ValueError for a channel that is much weaker or stronger than the rest."""
    gain_db = 20 * np.log10(np.maximum(np.abs(np.asarray(response)), TINY))
    off = gain_db - np.median(gain_db)
    if abs(off[worst := int(np.abs(off).argmax())]) > LARGEST_DB:
        tx, rx = divmod(worst, radar.num_rx)
        raise ValueError(
            f"transmitter {tx} with receiver {rx} is {off[worst]:+.0f} dB off the "
            f"other channels, expected at most {LARGEST_DB:g} dB: is it broken?"
        )
