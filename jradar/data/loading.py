"""Prepared frames to batches of images, each a pure function of (seed, step).

    Records --PairSource--> Pair --Batches--> stacked pairs of a step

Images are computed on reading, so one preparation serves every size of image and every
number of slices.
"""

import concurrent.futures
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jradar.data.records import PreparedFrame, package
from jradar.range_image import CHANNELS, ImageSpec, condition_image, project
from jradar.recordings.recording import Stream
from jradar.types import PointCloud

PREFETCHED = 2  # batches


class Pair(NamedTuple):
    """The network's input and the range image that it should return."""

    condition: Float[np.ndarray, "*batch row column channel"]
    lidar: Float[np.ndarray, "*batch lidar_row lidar_column"]  # metres, 0 for a miss


class PairSource(Stream):
    """The pairs of prepared frames, computed on reading."""

    def __init__(
        self,
        source: Sequence[PreparedFrame],
        coarse: ImageSpec,
        fine: ImageSpec,
        *,
        num_slices: int,
    ):
        """`source` is `Records` or a list of frames.

        `coarse` is the grid of the condition, `fine` the grid of the LiDAR image.
        """
        self._source, self._coarse, self._fine = source, coarse, fine
        self._num_slices = num_slices
        super().__init__(self._pair, len(source))

    def _pair(self, index):
        frame = self._source[index]
        condition = condition_image(
            frame.radar, self._coarse, num_slices=self._num_slices
        )
        return Pair(np.asarray(condition), lidar_image(frame.lidar_xyz, self._fine))


def mirrored(pair: Pair, random: np.random.Generator) -> Pair:
    """Return the pair, mirrored left to right with probability 0.5.

    Only for images whose view is as wide to the left as to the right.
    """
    if random.random() < 0.5:
        return pair
    return Pair(pair.condition[:, ::-1], pair.lidar[:, ::-1])


def thinned(pair: Pair, random: np.random.Generator, *, most: float) -> Pair:
    """Return the pair without some radar points: a share of them, 0 to `most`."""
    slices = pair.condition.shape[-1] // len(CHANNELS)
    kept = random.random((*pair.condition.shape[:2], slices)) >= random.uniform(0, most)
    kept = np.tile(kept, len(CHANNELS)).astype(pair.condition.dtype)
    return Pair(pair.condition * kept, pair.lidar)


def lidar_image(
    xyz: Float[np.ndarray, "point 3"], spec: ImageSpec
) -> Float[np.ndarray, "row column"]:
    """Project a LiDAR cloud of any size, on the host; pixels without points are 0."""
    count = len(xyz)
    # Few sizes exist, each is compiled once.
    padded = np.zeros((max(1024, 1 << max(count - 1, 0).bit_length()), 3), np.float32)
    padded[:count] = xyz
    cloud = PointCloud(jnp.asarray(padded), jnp.arange(len(padded)) < count)
    return np.asarray(project(cloud, spec))


class Batches(Stream):
    """Batches of a shuffled source by step; later batches are read ahead in threads.

    The source is repeated without end and shuffled anew in every epoch. The same seed
    gives the same batches.
    """

    def __init__(
        self,
        source: Sequence,
        *,
        seed: int,
        batch_size: int,
        change: Callable[[Any, np.random.Generator], Any] | None = None,
    ):
        """`change` alters each drawn item at random, as `mirrored` does.

        Its random numbers depend on the seed and the item's place only. Raises
        ValueError for an empty source.
        """
        if not len(source):
            raise ValueError("no frames to draw batches from")
        items = package("grain").MapDataset.source(source).seed(seed).shuffle().repeat()
        self._items = items if change is None else items.random_map(change)
        self._batch_size = batch_size
        self._pool = concurrent.futures.ThreadPoolExecutor(PREFETCHED)
        self._pending: dict[int, concurrent.futures.Future] = {}
        super().__init__(self._batch, len(self._items) // batch_size)

    def _batch(self, step):
        wanted = range(step, step + 1 + PREFETCHED)
        self._pending = {
            i: self._pending.get(i) or self._pool.submit(self._load, i) for i in wanted
        }
        return self._pending.pop(step).result()

    def _load(self, step):
        first = step * self._batch_size
        items = [self._items[first + k] for k in range(self._batch_size)]
        return jax.tree.map(lambda *leaves: np.stack(leaves), *items)
