"""How unlike a training set a condition is: a warning before a cloud is believed.

A network answers every condition, even one of a kind that it never saw. The features
of a condition are, for each range slice, the share of pixels with a point and the mean
power of these points. Those of a training set are described by a Gaussian, and a new
condition by its distance from it (Mahalanobis 1936), given as the share of training
frames that lie nearer: above 0.99, hardly any training frame looked like it.

    features of training conditions --fit_trust--> TrustTable
    features, TrustTable            --unlikeness--> 0 .. 1

Grids of `jradar.model` say what the features of a condition are.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.range_image.codec import CHANNELS

STEPS = 200  # quantiles that a TrustTable keeps
LEAST_FRAMES = 40
STRANGE = 0.99  # share of training frames that are more usual than a strange frame
RIDGE = 0.01  # of the features' variance, added so that no direction is without spread


class TrustTable(NamedTuple):
    """A Gaussian of training features, and the distances of other training frames."""

    mean: Float[Array | np.ndarray, " feature"]
    whitening: Float[Array | np.ndarray, "feature feature"]
    distances: Float[Array | np.ndarray, " step"]  # rising quantiles, from 0 to 1

    @classmethod
    def of(cls, mean: Any, whitening: Any, distances: Any) -> "TrustTable":
        """Return the table, or raise ValueError for parts that do not fit."""
        table = cls(*(np.asarray(v, np.float32) for v in (mean, whitening, distances)))
        size = len(table.mean)
        if table.whitening.shape != (size, size) or table.distances.ndim != 1:
            raise ValueError(
                f"whitening has shape {table.whitening.shape} and distances "
                f"{table.distances.shape}, expected {(size, size)} and one axis"
            )
        return table


@jit(static_argnames="channels")
def condition_features(
    condition: Float[Array, "*batch row column channel"],
    *,
    channels: tuple[str, ...] = CHANNELS,
) -> Float[Array, "*batch feature"]:
    """Return the share of occupied pixels and the mean power of each slice."""
    slices = condition.shape[-1] // len(channels)
    present = condition[..., :slices]
    power = condition[..., CHANNELS.index("power") * slices :][..., :slices]
    count = present.sum((-3, -2))
    share = count / (condition.shape[-3] * condition.shape[-2])
    mean = power.sum((-3, -2)) / jnp.maximum(count, 1.0)
    return jnp.concatenate([jnp.sqrt(share), mean], -1)


def fit_trust(features: Float[np.ndarray, "frame feature"]) -> TrustTable:
    """Return the description of a training set, on the host.

    Every other frame gives the Gaussian, the rest give the distances. Raises ValueError
    for fewer than 40 frames.
    """
    if len(features) < LEAST_FRAMES:
        raise ValueError(f"{len(features)} frames, expected {LEAST_FRAMES} or more")
    fitted, left = features[::2].astype(float), features[1::2]
    mean = fitted.mean(0)
    covariance = np.cov(fitted.T)
    covariance += RIDGE * covariance.trace() / len(mean) * np.eye(len(mean))
    values, vectors = np.linalg.eigh(covariance)
    whitening = (vectors / np.sqrt(values)).T
    distance = np.linalg.norm((left - mean) @ whitening.T, axis=-1)
    quantiles = np.quantile(distance, np.linspace(0, 1, STEPS + 1))
    return TrustTable.of(mean.round(6), whitening.round(6), quantiles.round(6))


@jit
def unlikeness(
    features: Float[Array, "*batch feature"], trust: TrustTable
) -> Float[Array, "*batch"]:
    """Return the share of training frames that are nearer to the mean, 0 to 1."""
    apart = features - jnp.asarray(trust.mean)
    distance = jnp.linalg.norm(apart @ jnp.asarray(trust.whitening).T, axis=-1)
    steps = jnp.linspace(0.0, 1.0, trust.distances.shape[0])
    return jnp.interp(distance, jnp.asarray(trust.distances), steps)
