"""Several frames of a recording as one, held together by their recorded poses."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar import data
from jradar.diffusion import RangeMixture
from jradar.evaluation import Method
from jradar.model import Model, fuse, mixtures, moving_pixels
from jradar.motion import ego_velocity
from jradar.radar import RadarSpec
from jradar.range_image import image_cloud
from jradar.types import PointCloud

KEY = 22  # of the samples that find the radar's velocity


class Seen(NamedTuple):
    """What one frame tells."""

    mixture: RangeMixture
    moving: Bool[Array, "row column"]
    velocity: Float[Array, " 3"]  # of the radar in m/s, NaN where unknown


def see(cloud: PointCloud, condition: Any, model: Model, radar: RadarSpec) -> Seen:
    """Return what one frame tells of surfaces, movers and the radar's velocity."""
    cloud = jax.tree.map(jnp.asarray, cloud)
    unambiguous = radar.max_velocity_mps
    velocity = ego_velocity(
        jax.random.key(KEY),
        cloud,
        elevation=radar.has_elevation,
        unambiguous_mps=unambiguous,
        folds=0,
    ).velocity
    mixture = mixtures(jnp.asarray(condition), model)
    moving = moving_pixels(
        mixture, cloud, velocity, model.spec, unambiguous_mps=unambiguous
    )
    return Seen(mixture, moving, velocity)


def fused(
    model: Model, records: data.Records, pairs: data.PairSource, count: int
) -> Method:
    """Return the method that fuses a frame with the `count` - 1 before it.

    Earlier frames that the records lack are left out, and so are all of a sequence
    without poses.
    """
    index = {place: i for i, place in enumerate(records.where)}

    @functools.lru_cache(2 * count)
    def seen(i: int) -> tuple[Seen, np.ndarray]:
        frame = records[i]
        radar = records.radar_of(frame.sequence)
        told = see(frame.radar, pairs[i].condition, model, radar)
        return told, frame.world_from_radar

    def call(key, frame):
        sequence, number = frame.prepared.sequence, frame.prepared.frame
        found = [index.get((sequence, number - k)) for k in range(count)]
        frames = [seen(found[0] if i is None else i) for i in found]
        stacked = jax.tree.map(lambda *v: jnp.stack(v), *[seen for seen, _ in frames])
        poses = relative_poses([pose for _, pose in frames])
        poses[[i is None for i in found]] = np.nan
        image = fuse(
            stacked.mixture,
            jnp.asarray(poses, jnp.float32),
            model.spec,
            moving=stacked.moving,
        )
        return image_cloud(image, model.spec.fine)

    return call


def relative_poses(
    world_from_radar: list[Float[np.ndarray, "4 4"]],
) -> Float[np.ndarray, "frame 4 4"]:
    """Return each frame's pose as the first one sees it; NaN without a pose."""
    if not np.isfinite(world_from_radar[0]).all():
        poses = np.full((len(world_from_radar), 4, 4), np.nan)
    else:
        poses = np.linalg.inv(world_from_radar[0]) @ np.stack(world_from_radar)
    poses[0] = np.eye(4)
    return poses
