"""Prepared frames to batches of images, each a pure function of (seed, step).

    Records --PairSource--> Pair
    Records --Batches, AugmentedPairs--> stacked pairs of a step

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

from jradar.data.augment import AugmentSpec, augmented
from jradar.data.histories import History
from jradar.data.records import PreparedFrame, package
from jradar.errors import UsageError
from jradar.model import ModelSpec, ViewGrid
from jradar.range_image import CHANNELS, ImageSpec, condition_image, project
from jradar.recordings.recording import Stream
from jradar.types import PointCloud

PREFETCHED = 2  # batches


class Pair(NamedTuple):
    """The network's input and the range image that it should return."""

    condition: Float[np.ndarray, "*batch row column channel"]
    lidar: Float[np.ndarray, "*batch lidar_row lidar_column"]  # metres, 0 for a miss


class Batch(NamedTuple):
    """Conditions, and the encoded images that a network learns to draw."""

    condition: Float[Any, "batch row column channel"]
    target: Float[Any, "batch target_row target_column target_channel"]


class PairSource(Stream):
    """The pairs of prepared frames, computed on reading."""

    def __init__(
        self,
        source: Sequence[PreparedFrame],
        coarse: ImageSpec,
        fine: ImageSpec,
        *,
        num_slices: int,
        channels: tuple[str, ...] = CHANNELS,
    ):
        """`source` is `Records` or a list of frames.

        `coarse` is the grid of the condition, `fine` the grid of the LiDAR image.
        """
        self._source, self._coarse, self._fine = source, coarse, fine
        self._slices: Any = {"num_slices": num_slices, "channels": channels}
        super().__init__(self._pair, len(source))

    def _pair(self, index):
        frame = self._source[index]
        return make_pair(frame, self._coarse, self._fine, **self._slices)


def joined(*sources: Sequence) -> Stream:
    """Return the items of all sources, one after another."""
    ends = np.cumsum([0, *map(len, sources)])

    def item(index):
        which = int(np.searchsorted(ends, index, side="right")) - 1
        return sources[which][index - int(ends[which])]

    return Stream(item, int(ends[-1]))


def pairs_of(spec: ModelSpec, frames: Sequence[PreparedFrame]) -> PairSource:
    """Return the pairs of prepared frames on a model's grids.

    Raises UsageError for a model that does not see a radar's points: that is all that
    records hold.
    """
    if not isinstance(grid := spec.grid, ViewGrid):
        raise UsageError(
            f"records hold a radar's points, and a model of {grid.kind} images does "
            "not see these: use a model of range images, such as jradar-sim"
        )
    slices: Any = {"num_slices": grid.num_slices, "channels": grid.channels}
    return PairSource(frames, grid.coarse, grid.fine, **slices)


def make_pair(
    frame: PreparedFrame,
    coarse: ImageSpec,
    fine: ImageSpec,
    *,
    num_slices: int,
    channels: tuple[str, ...] = CHANNELS,
) -> Pair:
    """Return the images of a frame, see `PairSource`; a host function."""
    slices: Any = {"num_slices": num_slices, "channels": channels}
    condition = condition_image(frame.radar, coarse, **slices)
    return Pair(np.asarray(condition), lidar_image(frame.lidar_xyz, fine))


class AugmentedPairs(NamedTuple):
    """A change for `Batches` of frames: each becomes a pair, changed at random.

    Pixels of the LiDAR's image are -1 where it is unknown what a scan would see.
    """

    coarse: ImageSpec
    fine: ImageSpec
    num_slices: int
    augment: AugmentSpec
    channels: tuple[str, ...] = CHANNELS

    def __call__(
        self, frame: PreparedFrame | History, random: np.random.Generator
    ) -> Pair:
        """Return the pair of a frame, or of a history that is drawn anew."""
        if isinstance(frame, History):
            frame = frame.drawn(random)
        frame, unknown = augmented(frame, random, self.augment)
        slices: Any = {"num_slices": self.num_slices, "channels": self.channels}
        pair = make_pair(frame, self.coarse, self.fine, **slices)
        return pair._replace(lidar=unknown.marked(pair.lidar, self.fine.azimuth))


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
        """`change` alters each drawn item at random, as `AugmentedPairs` does.

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
