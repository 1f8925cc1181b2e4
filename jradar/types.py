"""The point cloud, and the names of axes that all docstrings use.

    tx, rx      transmit and receive antennas, in array order
    virtual     the tx-rx pairs, tx major: `virtual = tx * num_rx + rx`
    chirp       chirps of one transmitter within a frame (slow time)
    sample      ADC samples within a chirp (fast time)
    doppler     velocity bins, zero velocity in the middle, receding targets above it
    range       range bins, bin 0 at the sensor
    elevation   directions up and down, positive up
    azimuth     directions left and right, positive to the left
    row         image rows, row 0 the highest elevation
    column      image columns, column 0 the right-most azimuth
    slice       parts of the range axis, nearest first
    point       points of a cloud, padded to a fixed number
    level       resolutions of the network, level 0 the finest

Frames are x forward, y left, z up, in metres. Velocities are positive when the target
recedes.
"""

import importlib
import math
import os
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jradar.compiled import jit

Limit = float | Float[Array, ""]
SIZES = 1 << 10, 1 << 12, 1 << 14, 1 << 16  # of clouds that a radar sends, padded


class PointCloud(NamedTuple):
    """A cloud of fixed size: points that are not `valid` are padding.

    Quantities that a sensor does not measure are None, such as a LiDAR's velocity.
    `confidence` is the probability that a surface is near the point. `fold` and its
    margin are those of `jradar.radar.velocity_folds`, if asked for.
    """

    xyz: Float[Array, "*batch point 3"]
    valid: Bool[Array, "*batch point"]
    velocity: Float[Array, "*batch point"] | None = None
    power: Float[Array, "*batch point"] | None = None
    snr: Float[Array, "*batch point"] | None = None
    confidence: Float[Array, "*batch point"] | None = None
    fold: Int[Array, "*batch point"] | None = None
    fold_margin_db: Float[Array, "*batch point"] | None = None

    @classmethod
    def from_xyz(cls, xyz: Any) -> "PointCloud":
        """Return the cloud of points `[*batch point 3]`.

        NaN, infinite points and (0, 0, 0), a missing return of a LiDAR, are invalid.
        """
        xyz = jnp.asarray(xyz, jnp.float32)
        if xyz.ndim < 2 or xyz.shape[-1] != 3:
            raise ValueError(
                f"points have shape {xyz.shape}, expected [*batch, point, 3]: "
                "pass x, y, z only"
            )
        valid = jnp.isfinite(xyz).all(-1) & (xyz != 0).any(-1)
        return cls(jnp.where(valid[..., None], xyz, 0.0), valid)

    def padded(self) -> "PointCloud":
        """Return one cloud with padding added, to 1,024, 4,096, 16,384 or 65,536.

        Clouds of a few sizes are compiled once each. Raises ValueError for a cloud that
        is larger than a radar's.
        """
        count = self.valid.shape[-1]
        size = next((size for size in SIZES if size >= count), None)
        if size is None:
            raise ValueError(
                f"a frame of {count:,} points, expected at most {SIZES[-1]:,} of a "
                "radar: is it a LiDAR's, or of many frames? Name the radar's own topic "
                "or file"
            )

        def pad(column):
            empty = ((0, size - count), *((0, 0),) * (column.ndim - 1))
            return np.pad(np.asarray(column), empty)

        columns = {k: v for k, v in self._asdict().items() if v is not None}
        return self._replace(**{name: pad(v) for name, v in columns.items()})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the valid points of one cloud: .ply, .pcd, .csv or .npz.

        A file of this name is replaced. Raises UsageError for another suffix.
        """
        importlib.import_module("jradar.outputs.clouds").save_cloud(path, self)

    def __repr__(self) -> str:
        """One line: the valid points, their extent in metres, and the other columns."""
        held = {k: v for k, v in self._asdict().items() if v is not None}
        try:
            xyz, valid = np.asarray(self.xyz), np.asarray(self.valid)
            found, shape = xyz[valid], valid.shape
        except (TypeError, IndexError):  # placeholders of JAX have no values
            return f"PointCloud({', '.join(f'{k}={v!r}' for k, v in held.items())})"
        text = f"{len(found):,} of {valid.size:,} points"
        if len(shape) > 1:
            text += f" in {math.prod(shape[:-1]):,} clouds"
        if len(found):
            spans = zip("xyz", found.min(0), found.max(0), strict=True)
            spans = [f"{axis} {low:.2f} to {high:.2f}" for axis, low, high in spans]
            text += f", {', '.join(spans)} m"
        columns = "".join(f", {name}" for name in [*held][2:])
        return f"PointCloud({text}{columns})"

    @jit
    def within(
        self,
        *,
        min_range_m: Limit = 0.0,
        max_range_m: Limit = math.inf,
        max_azimuth: Limit = math.pi,
        max_elevation: Limit = math.pi / 2,
    ) -> "PointCloud":
        """Return the cloud in which points beyond these limits are not valid.

        Angles are in radians, to either side of straight ahead.
        """
        x, y, z = jnp.moveaxis(self.xyz, -1, 0)
        ground = jnp.hypot(x, y)
        distance, elevation = jnp.hypot(ground, z), jnp.arctan2(z, ground)
        kept = (distance >= min_range_m) & (distance <= max_range_m)
        kept &= (abs(jnp.arctan2(y, x)) <= max_azimuth) & (
            abs(elevation) <= max_elevation
        )
        return self._replace(valid=self.valid & kept)


def check_one_cloud(cloud: PointCloud, function: str) -> None:
    """Raise ValueError for a batch of clouds, where `function` takes one."""
    if cloud.xyz.ndim != 2 or cloud.xyz.shape[:1] != cloud.valid.shape:
        raise ValueError(
            f"{function}: xyz has shape {cloud.xyz.shape} and valid "
            f"{cloud.valid.shape}, expected one cloud, [point, 3] and [point]: for a "
            f"batch of clouds use jax.vmap"
        )
