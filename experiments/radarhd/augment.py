"""Changes of a pair of polar images that leave it a possible pair.

Each function takes a generator, a radar image [range, radar_azimuth, history] of 0 to 1
and an occupancy image [range, azimuth, 1] of 0 or 1, and returns both, changed. Pixels
that come from outside the images are 0. `paste_sector` also takes another pair.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from experiments.radarhd.pairs import LIDAR, RADAR, PolarItem, turned

Radar = Float[np.ndarray, "range radar_azimuth history"]
Occupied = Float[np.ndarray, "range azimuth 1"]
Pair = tuple[Radar, Occupied]
SCALES = (0.8, 1.25)  # of ranges
MOST_TURN = 10  # radar azimuth cells to either side, 29 degrees
GAINS, GAMMAS = (0.7, 1.3), (0.7, 1.4)
SPECKLE = 0.3  # standard deviation of the factor of each pixel
MOST_DROPPED = 8  # neighbouring azimuth cells of the radar
SECTORS = np.deg2rad((30.0, 90.0))  # widths of a pasted sector


def scale_ranges(rng: np.random.Generator, radar: Radar, occupied: Occupied) -> Pair:
    """Move everything nearer or farther by one factor: a smaller or larger room."""
    low, high = np.log(SCALES)
    factor = np.exp(rng.uniform(low, high))
    source = np.rint(np.arange(LIDAR.num_range) / factor).astype(int)
    return _rows(radar, source), _rows(occupied, source)


def turn(rng: np.random.Generator, radar: Radar, occupied: Occupied) -> Pair:
    """Turn both images about the radar, by whole radar cells."""
    angle = rng.integers(-MOST_TURN, MOST_TURN + 1) * RADAR.azimuth_step
    return turned(radar, RADAR, angle), turned(occupied, LIDAR, angle)


def change_gain(rng: np.random.Generator, radar: Radar, occupied: Occupied) -> Pair:
    """Change the radar's gain and the curve of its grey values."""
    gain, gamma = rng.uniform(*GAINS), rng.uniform(*GAMMAS)
    return np.clip(gain * radar**gamma, 0, 1).astype(radar.dtype), occupied


def add_speckle(rng: np.random.Generator, radar: Radar, occupied: Occupied) -> Pair:
    """Multiply each radar pixel by a random factor around 1."""
    factor = 1 + SPECKLE * rng.standard_normal(radar.shape)
    return np.clip(radar * factor, 0, 1).astype(radar.dtype), occupied


def drop_azimuths(rng: np.random.Generator, radar: Radar, occupied: Occupied) -> Pair:
    """Blank a few neighbouring azimuth cells of the radar."""
    width = rng.integers(1, MOST_DROPPED + 1)
    first = rng.integers(0, RADAR.num_azimuth - width + 1)
    changed = radar.copy()
    changed[:, first : first + width] = 0
    return changed, occupied


def paste_sector(
    rng: np.random.Generator, radar: Radar, occupied: Occupied, other: Pair
) -> Pair:
    """Replace a sector of both images by that of another pair.

    The radar's side lobes end at the sector's borders, which those of a real radar do
    not.
    """
    low, high = LIDAR.azimuth
    width = rng.uniform(*SECTORS)
    first = rng.uniform(low, high - width)
    images = []
    for image, grid, pasted in zip(
        (radar, occupied), (RADAR, LIDAR), other, strict=True
    ):
        inside = (grid.angles >= first) & (grid.angles < first + width)
        images.append(np.where(inside[:, None], pasted, image))
    return images[0], images[1]


AUGMENTATIONS: dict[str, Callable[..., Pair]] = {
    "scale": scale_ranges,
    "turn": turn,
    "gain": change_gain,
    "speckle": add_speckle,
    "drop": drop_azimuths,
    "paste": paste_sector,
}


def augmented(
    item: PolarItem,
    rng: np.random.Generator,
    *,
    names: Sequence[str],
    others: Sequence[PolarItem],
) -> PolarItem:
    """Return an item with each of the named changes, each at a chance of one half.

    Sectors are pasted from `others`.
    """
    for name in names:
        if rng.random() < 0.5:
            pasted = [others[rng.integers(len(others))]] if name == "paste" else []
            item = PolarItem(*AUGMENTATIONS[name](rng, *item, *pasted))
    return item


def _rows(image: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The rows `source` of an image, 0 for rows outside it."""
    known = (source >= 0) & (source < len(image))
    rows = image[np.clip(source, 0, len(image) - 1)]
    return np.where(known[:, None, None], rows, 0).astype(image.dtype)
