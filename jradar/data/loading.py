"""Prepared frames to batches of images, each a pure function of (seed, step).

Images are made on reading, so that one preparation serves every size of image and every
number of slices. `source` is anything with `len` and `source[i]` that gives prepared
frames: `Records`, or a list of them held in memory.
"""

import concurrent.futures
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jradar.data.records import EXTRA, PreparedFrame
from jradar.range_image import CHANNELS, ImageSpec, condition_image, project
from jradar.types import PointCloud


class Pair(NamedTuple):
    """What goes into the network and what should come out; batches stack them."""

    condition: Float[np.ndarray, "*batch row column channel"]
    lidar: Float[np.ndarray, "*batch lidar_row lidar_column"]  # metres, 0 for a miss


class PairSource(Sequence):
    """Images of the frames in `source`, made when asked for."""

    def __init__(
        self,
        source: Sequence[PreparedFrame],
        coarse: ImageSpec,
        fine: ImageSpec,
        *,
        num_slices: int,
        channels: tuple[str, ...] = CHANNELS,
    ):
        """`coarse` is the view of the condition, `fine` that of the LiDAR."""
        self._source = source
        self._images = functools.partial(
            _images, coarse=coarse, fine=fine, num_slices=num_slices, channels=channels
        )

    def __len__(self) -> int:
        return len(self._source)

    def __getitem__(self, index: int | slice) -> Any:
        """Pair `index`."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        frame = self._source[index]
        images = self._images(frame.radar, *_padded(frame.lidar_xyz))
        return Pair(*map(np.asarray, images))


def mirrored(pair: Pair, random: np.random.Generator) -> Pair:
    """The pair or, as often, its mirror image: a radar knows no left and right.

    For images that see as far to one side as to the other.
    """
    if random.random() < 0.5:
        return pair
    return Pair(pair.condition[:, ::-1], pair.lidar[:, ::-1])


def lidar_image(
    xyz: Float[np.ndarray, "point 3"], spec: ImageSpec
) -> Float[np.ndarray, "row column"]:
    """Range image of a LiDAR cloud of any size, on the host; 0 where no point fell."""
    padded, count = _padded(xyz)
    return np.asarray(_lidar_image(padded, count, spec))


def _padded(xyz):
    """Points padded to the next power of two, so that few sizes are compiled."""
    size = max(1024, 1 << max(len(xyz) - 1, 0).bit_length())
    padded = np.zeros((size, 3), np.float32)
    padded[: len(xyz)] = xyz
    return padded, len(xyz)


@functools.partial(jax.jit, static_argnames="spec")
def _lidar_image(padded, count, spec):
    """Range image of the first `count` points."""
    return project(PointCloud(padded, jnp.arange(len(padded)) < count), spec)


@functools.partial(
    jax.jit, static_argnames=("coarse", "fine", "num_slices", "channels")
)
def _images(radar, padded, count, *, coarse, fine, num_slices, channels):
    """Condition and LiDAR image of a frame in one call."""
    condition = condition_image(radar, coarse, num_slices=num_slices, channels=channels)
    return condition, _lidar_image(padded, count, fine)


class Batches(Sequence):
    """Batch `step` of a shuffled, endlessly repeated source; reads ahead.

    Grain shuffles every epoch anew. Each of `num_processes` processes gets its own part
    of the same global batch, so that a run goes on exactly with another number of them.
    """

    def __init__(
        self,
        source: Sequence,
        *,
        seed: int,
        batch_size: int,
        process_index: int = 0,
        num_processes: int = 1,
        prefetch: int = 2,
        change: Callable[[Any, np.random.Generator], Any] | None = None,
    ):
        """`batch_size` counts the items of all processes together.

        `change` alters items by chance, as `mirrored` does: anew whenever one is drawn,
        and always alike for the same seed.
        """
        if not len(source):
            raise ValueError("no frames to draw batches from")
        if batch_size % num_processes or not 0 <= process_index < num_processes:
            raise ValueError(
                f"{batch_size=} for process {process_index} of {num_processes}: "
                "expected a multiple of the number of processes"
            )
        try:
            import grain
        except ImportError as error:
            raise ImportError(EXTRA) from error
        items = grain.MapDataset.source(source).seed(seed).shuffle().repeat()
        self._items = items if change is None else items.random_map(change)
        self._batch_size, self._part = batch_size, batch_size // num_processes
        self._first = process_index * self._part
        self._prefetch = prefetch
        self._pool = concurrent.futures.ThreadPoolExecutor(max(prefetch, 1))
        self._pending: dict[int, concurrent.futures.Future] = {}

    def __len__(self) -> int:
        return len(self._items) // self._batch_size

    def __getitem__(self, step: int | slice) -> Any:
        """The part of batch `step` that is this process's, stacked."""
        if isinstance(step, slice):
            return [self[i] for i in range(*step.indices(len(self)))]
        wanted = range(step, step + 1 + self._prefetch)
        self._pending = {
            i: self._pending.get(i) or self._pool.submit(self._load, i) for i in wanted
        }
        return self._pending.pop(step).result()

    def _load(self, step):
        """Items of a step, stacked leaf by leaf."""
        first = step * self._batch_size + self._first
        items = [self._items[first + k] for k in range(self._part)]
        return jax.tree.map(lambda *leaves: np.stack(leaves), *items)
