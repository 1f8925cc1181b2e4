"""The radar's own velocity from the Doppler of one cloud.

An echo of something that stands still, in the unit direction u, recedes with

    v_r = -u . v            v: velocity of the radar, in the radar's frame, m/s

A few such echoes give v. Things that move do not fit, so echoes are selected by
consensus (Fischler & Bolles 1981), as in REVE (Doer & Trommer 2020):

    samples of 3 echoes -> hypotheses -> the one that most echoes agree with
                        -> weighted least squares over these, repeated

An array with one row of antennas measures no elevation: 2 echoes make a sample, and
only x and y are found. Doppler is measured modulo twice the unambiguous velocity; each
echo is then folded to the hypothesis, and the samples themselves are tried with every
combination of folds.
"""

import itertools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit
from jradar.types import PointCloud, check_one_cloud

REFINEMENTS = 3  # of inliers and velocity in turn
LEAST_SPREAD = 1e-6  # eigenvalue of the mean of u u^T: directions within 0.06 degrees
PREFER_SLOW = 1e-3  # echoes that 1 m/s must gain
MOST_HYPOTHESES = 1 << 16
STATIC = (
    *("elevation", "unambiguous_mps", "folds", "threshold_mps"),
    *("hypotheses", "least_inliers", "noise_mps"),
)


class EgoVelocity(NamedTuple):
    """The velocity of the radar, and the points that it was estimated from.

    Where `solved` is False, the velocity is NaN, its variances are infinite, and no
    point is an inlier or moving. The variance of z is infinite, and z is 0, without
    elevation. The covariance is that of independent errors of Doppler: errors that the
    directions share, such as a tilt or ghosts, come on top.
    """

    velocity: Float[Array, "*batch 3"]  # m/s, in the radar's frame
    covariance: Float[Array, "*batch 3 3"]  # (m/s)^2
    inliers: Bool[Array, "*batch point"]  # echoes that fit a world that stands still
    moving: Bool[Array, "*batch point"]  # echoes that do not: movers, ghosts
    solved: Bool[Array, "*batch"]


@jit(static_argnames=STATIC)
def ego_velocity(
    key: Array,
    cloud: PointCloud,
    *,
    elevation: bool = True,
    unambiguous_mps: float | None = None,
    folds: int = 1,
    threshold_mps: float = 0.15,
    hypotheses: int = 64,
    least_inliers: int = 5,
    noise_mps: float = 0.01,
) -> EgoVelocity:
    """Return the radar's velocity from the valid points of one cloud; `vmap` it.

    Inliers differ from -u . v by less than `threshold_mps`. They weigh by SNR or power
    up to the median, beyond which other errors than noise count. The covariance follows
    from the residuals, none of which counts as less than `noise_mps`. With
    `unambiguous_mps`, velocities up to `2 folds + 1` times it are considered. `solved`
    is False with fewer than `least_inliers`, or if their directions are all alike.
    Phase errors of the channels rotate all directions, and the velocity with them: the
    vertical velocity of an uncalibrated radar is off by its tilt times its speed.

    Raises ValueError for a cloud without velocities and for a batch of clouds.
    """
    check_one_cloud(cloud, "ego_velocity")
    if cloud.velocity is None:
        raise ValueError(
            "ego_velocity: the cloud has no velocity: pass the cloud of radar_points"
        )
    _check_options(unambiguous_mps, folds, threshold_mps, hypotheses, noise_mps)
    axes = 3 if elevation else 2
    if least_inliers <= axes:
        raise ValueError(
            f"{least_inliers=}, expected more than the {axes} unknowns: residuals of "
            "fewer echoes say nothing"
        )
    kind = jnp.promote_types(cloud.xyz.dtype, jnp.float32)  # half cannot be solved
    xyz, receding = cloud.xyz.astype(kind), cloud.velocity.astype(kind)
    square = (xyz**2).sum(-1)
    usable = cloud.valid & jnp.isfinite(receding)
    usable &= jnp.isfinite(square) & (square > 0)
    # Replaced before the norm, which has no gradient at the origin.
    xyz = jnp.where(usable[:, None], xyz, 1.0)
    away = jnp.linalg.norm(xyz, axis=-1, keepdims=True)
    direction = jnp.where(usable[:, None], xyz[:, :axes] / away, 0.0)
    doppler = jnp.where(usable, receding, 0.0)
    period = None if unambiguous_mps is None else 2 * unambiguous_mps

    fixed = jax.lax.stop_gradient((direction, doppler))
    samples = _samples(key, usable, hypotheses, axes)
    velocity = _hypotheses(samples, *fixed, period, folds)
    velocity = _best(velocity, *fixed, usable, period, threshold_mps)

    strength = _strength(cloud, usable)
    weight = inverse = spread = jnp.zeros(())
    for _ in range(REFINEMENTS):
        echo = _residual(velocity, direction, doppler, period)
        inliers = usable & (jnp.abs(echo) < threshold_mps)
        weight = jax.lax.stop_gradient(jnp.where(inliers, strength, 0.0))
        velocity, inverse, spread = _least_squares(velocity, direction, echo, weight)
    residual = _residual(velocity, direction, doppler, period)
    inliers = usable & (jnp.abs(residual) < threshold_mps)
    count = inliers.sum()
    solved = (count >= least_inliers) & (spread > LEAST_SPREAD)
    covariance = _covariance(direction, weight, residual, inverse, noise_mps)
    return EgoVelocity(
        velocity=_in_space(jnp.where(solved, velocity, jnp.nan), 0.0),
        covariance=_variances(jnp.where(solved, covariance, 0.0), solved),
        inliers=inliers & solved,
        moving=usable & ~inliers & solved,
        solved=solved,
    )


def _check_options(unambiguous_mps, folds, threshold_mps, hypotheses, noise_mps):
    if min(threshold_mps, noise_mps) <= 0:
        raise ValueError(f"{threshold_mps=}, {noise_mps=}, expected more than 0 m/s")
    if unambiguous_mps is not None and not unambiguous_mps > threshold_mps:
        raise ValueError(
            f"{unambiguous_mps=}, expected more than {threshold_mps=}: every echo "
            "would fit any velocity"
        )
    tried = hypotheses * (1 if unambiguous_mps is None else (2 * folds + 1) ** 3)
    if hypotheses < 1 or folds < 0 or tried > MOST_HYPOTHESES:
        raise ValueError(
            f"{hypotheses=}, {folds=}, expected 1 or more hypotheses, 0 or more folds "
            f"and at most {MOST_HYPOTHESES:,} hypotheses (2 folds + 1)^3"
        )


def _samples(key, usable, hypotheses, axes):
    """Indices of echoes [hypothesis, axes]; a sample may hold an echo twice."""
    first = jnp.argsort(~usable)
    place = jax.random.uniform(key, (hypotheses, axes)) * usable.sum()
    return first[place.astype(int)]


def _hypotheses(samples, direction, doppler, period, folds):
    """Velocities [hypothesis, axes] that explain the samples, by Cramer's rule."""
    u, v_r = direction[samples], doppler[samples]
    if period is not None:
        axes = samples.shape[-1]
        turns = itertools.product(range(-folds, folds + 1), repeat=axes)
        shift = period * jnp.asarray(np.array([*turns]), jnp.float32)
        v_r = (v_r[:, None] + shift[None]).reshape(-1, axes)
        u = jnp.repeat(u, len(shift), 0)
    if u.shape[-1] == 2:
        (a, b), (c, d) = (u[:, k].T for k in (0, 1))
        volume = a * d - b * c
        x, y = v_r.T
        return -jnp.stack([d * x - b * y, a * y - c * x], -1) / volume[:, None]
    faces = jnp.stack([jnp.cross(u[:, k - 2], u[:, k - 1]) for k in range(3)], 1)
    volume = (u[:, 0] * faces[:, 0]).sum(-1)
    return -jnp.einsum("hk,hki->hi", v_r, faces) / volume[:, None]


def _best(velocity, direction, doppler, usable, period, threshold_mps):
    """The hypothesis with the least sum of squares, cut off at the threshold."""

    def total_cost(one):
        residual = _residual(one, direction, doppler, period)
        cost = jnp.minimum((residual / threshold_mps) ** 2, 1.0) * usable
        return cost.sum() + PREFER_SLOW * jnp.linalg.norm(one)

    total = jax.vmap(total_cost)(velocity)
    best = velocity[jnp.argmin(jnp.where(jnp.isfinite(total), total, jnp.inf))]
    return jnp.where(jnp.isfinite(best), best, 0.0)


def _residual(velocity, direction, doppler, period):
    """Doppler minus that of a world that stands still, folded [point]."""
    residual = doppler + direction @ velocity
    if period is None:
        return residual
    return residual - period * jnp.round(residual / period)


def _strength(cloud, usable):
    """Weights from 0 to 1: in proportion to a weak echo's SNR, 1 for strong ones."""
    strength = cloud.power if cloud.snr is None else cloud.snr
    if strength is None:
        return jnp.ones(usable.shape)
    known = usable & jnp.isfinite(strength) & (strength > 0)
    median = jnp.nanmedian(jnp.where(known, strength, jnp.nan))
    return jnp.where(known, strength / (strength + median), 0.0)


def _least_squares(velocity, direction, residual, weight):
    """The corrected velocity, the inverse normal matrix, and its least eigenvalue."""
    weighted = weight[:, None] * direction
    normal, side = weighted.T @ direction, weighted.T @ residual
    mean = jax.lax.stop_gradient(normal / jnp.maximum(weight.sum(), 1e-30))
    spread = jnp.linalg.eigvalsh(mean)[0]
    safe = spread > LEAST_SPREAD
    normal = jnp.where(safe, normal, jnp.eye(len(normal)))
    inverse = jnp.linalg.inv(normal)
    step = jnp.where(safe, inverse @ side, 0.0)
    return velocity - step, inverse, spread


def _covariance(direction, weight, residual, inverse, noise_mps):
    """The covariance without trust in the weights (MacKinnon & White 1985, HC2)."""
    leverage = weight * jnp.einsum("pi,ij,pj->p", direction, inverse, direction)
    # Without any echo left over, a residual says nothing: a leverage of 1 is cut off.
    square = residual**2 / jnp.maximum(1 - leverage, 0.1)
    scale = weight**2 * jnp.maximum(square, noise_mps**2)
    return inverse @ (scale[:, None] * direction).T @ direction @ inverse


def _in_space(vector, rest):
    """The vector with `rest` in place of axes that are not measured."""
    return jnp.pad(vector, (0, 3 - len(vector)), constant_values=rest)


def _variances(covariance, solved):
    """The covariance [3, 3], infinite on the diagonal for unknown axes."""
    axes = len(covariance)
    unknown = jnp.arange(3) >= jnp.where(solved, axes, 0)
    covariance = jnp.pad(covariance, (0, 3 - axes))
    return covariance + jnp.diag(jnp.where(unknown, jnp.inf, 0.0))
