"""Several frames of records as one, held together by their recorded poses."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jradar import data
from jradar.evaluation import Method
from jradar.model import Model
from jradar.range_image import image_cloud
from jradar.session import Seen, fused, see


def fused_method(
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
        cloud = jax.tree.map(jnp.asarray, frame.radar)
        condition = jnp.asarray(pairs[i].condition)
        radar = records.radar_of(frame.sequence)
        return see(cloud, condition, model, radar), frame.world_from_radar

    def call(key, frame):
        sequence, number = frame.prepared.sequence, frame.prepared.frame
        found = [index.get((sequence, number - k)) for k in range(count)]
        frames = [seen(found[0] if i is None else i) for i in found]
        poses = relative_poses([pose for _, pose in frames])
        poses[[i is None for i in found]] = np.nan
        image = fused(
            [seen for seen, _ in frames], jnp.asarray(poses, jnp.float32), model
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
