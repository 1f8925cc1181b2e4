"""A map of voxels from clouds and poses; each has the log-odds of being occupied.

A point is evidence for the voxel that holds it, and against the voxels on the way to
it. The log-odds are bounded after every frame, so that a map can change its mind
(OctoMap, Hornung et al. 2013, whose probabilities are the defaults here). Resolution
and range are those of RMap's radar maps of ColoRadar (Mopidevi et al. 2023).
"""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

SPAN = 1 << 20  # voxels of an axis that a key tells apart
MERGED = 64  # frames whose voxels are sorted at once


@dataclasses.dataclass(frozen=True)
class SensorModel:
    """How a detection changes a map."""

    voxel_m: float = 0.15
    max_range_m: float = 10.0  # farther detections are left out
    hit: float = 0.7  # probability of a voxel after one detection in it
    miss: float = 0.4  # and after one behind it
    least: float = 0.12  # bounds of the probability
    most: float = 0.97

    def __post_init__(self):
        """Refuse probabilities from which nothing follows, or the opposite."""
        if not self.voxel_m > 0:
            raise ValueError(f"voxel_m = {self.voxel_m}, expected more than 0")
        if not 0 < self.least <= self.miss < 0.5 < self.hit <= self.most < 1:
            raise ValueError(
                f"least = {self.least}, miss = {self.miss}, hit = {self.hit}, most = "
                f"{self.most}: expected to rise within 0 to 1, with 0.5 between miss "
                "and hit"
            )


class VoxelMap:
    """The voxels that points were in or behind, and their log-odds."""

    def __init__(self, sensor: SensorModel = SensorModel()):
        """Start an empty map."""
        self.sensor = sensor
        self._keys = np.zeros(0, np.int64)
        self._odds = np.zeros(0)
        self._new: list[tuple[np.ndarray, np.ndarray]] = []

    def add(
        self,
        xyz: Float[np.ndarray, "point 3"],
        world_from_sensor: Float[np.ndarray, "4 4"],
        *,
        probability: Float[np.ndarray, " point"] | None = None,
    ) -> None:
        """Add the points of one frame, in the sensor's frame.

        A voxel counts once in a frame. If points are in it, it counts as occupied, with
        the largest of their probabilities, by default the sensor model's. Raises
        ValueError for a pose that is not finite, or farther than the map counts voxels.
        """
        pose = np.asarray(world_from_sensor, float)
        farthest_m = SPAN / 2 * self.sensor.voxel_m - self.sensor.max_range_m
        if not (np.isfinite(pose).all() and np.abs(pose[:3, 3]).max() < farthest_m):
            raise ValueError(
                f"pose {pose.tolist()}, expected finite numbers of metres, and less "
                f"than {farthest_m:,.0f} m along each axis with voxels of "
                f"{self.sensor.voxel_m:g} m: begin the world nearer"
            )
        xyz = np.asarray(xyz, float).reshape(-1, 3)
        share = (
            np.full(len(xyz), self.sensor.hit) if probability is None else probability
        )
        range_m = np.linalg.norm(xyz, axis=1)
        kept = np.isfinite(range_m) & (range_m <= self.sensor.max_range_m)
        order = np.argsort(share[kept], kind="stable")[::-1]  # the likeliest first
        points = xyz[kept][order] @ pose[:3, :3].T + pose[:3, 3]
        hits, first = np.unique(self._key(points), return_index=True)
        share = np.clip(share[kept][order][first], self.sensor.least, self.sensor.most)
        misses = np.setdiff1d(self._key(self._before(points, pose[:3, 3])), hits)
        against = np.full(len(misses), _log_odds(self.sensor.miss))
        self._new += [(hits, _log_odds(share)), (misses, against)]
        if len(self._new) >= 2 * MERGED:
            self._merge()

    def occupied(
        self, *, above: float = 0.5
    ) -> tuple[Int[np.ndarray, "voxel 3"], Float[np.ndarray, " voxel"]]:
        """Return the voxels of a probability `above` this, and their probabilities."""
        self._merge()
        probability = 1 / (1 + np.exp(-self._odds))
        kept = probability > above
        return self._voxels(self._keys[kept]), probability[kept]

    def free(self) -> Int[np.ndarray, "voxel 3"]:
        """Return the voxels that are more likely empty than occupied."""
        self._merge()
        return self._voxels(self._keys[self._odds < 0])

    def _before(self, points, origin):
        """Return places from the sensor to each point, half a voxel apart."""
        step = self.sensor.voxel_m / 2
        away = points - origin
        length = np.linalg.norm(away, axis=1)
        counts = np.maximum(np.ceil(length / step).astype(int) - 2, 0)
        index = np.repeat(np.arange(len(points)), counts)
        number = np.arange(counts.sum()) - np.repeat(counts.cumsum() - counts, counts)
        part = step * number / np.maximum(length[index], step)
        return origin + part[:, None] * away[index]

    def _merge(self):
        """Add what frames have brought, one by one within the bounds."""
        parts = [self._keys, *(keys for keys, _ in self._new)]
        self._keys, index = np.unique(np.concatenate(parts), return_inverse=True)
        before, *places = np.split(index, np.cumsum([len(part) for part in parts[:-1]]))
        odds = np.zeros(len(self._keys))
        odds[before] = self._odds
        low, high = _log_odds(np.array([self.sensor.least, self.sensor.most]))
        for place, (_, change) in zip(places, self._new, strict=True):
            odds[place] = np.clip(odds[place] + change, low, high)
        self._odds, self._new = odds, []

    def _key(self, points):
        """One number for each voxel."""
        voxels = np.floor(points / self.sensor.voxel_m).astype(np.int64) + SPAN // 2
        return (voxels[:, 0] * SPAN + voxels[:, 1]) * SPAN + voxels[:, 2]

    def _voxels(self, keys):
        """The numbers of voxels along the axes."""
        rest, z = np.divmod(keys, SPAN)
        return np.stack([*np.divmod(rest, SPAN), z], -1) - SPAN // 2


def _log_odds(probability):
    """ln(p / (1 - p))."""
    return np.log(probability / (1 - probability))
