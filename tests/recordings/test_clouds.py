"""Clouds to files: an independent reader gets the valid points back; empty clouds."""

import jax.numpy as jnp
import numpy as np
import pytest
from trimesh.exchange.ply import load_ply

from jradar.recordings import write_npz, write_ply
from jradar.types import PointCloud


def cloud(num):
    xyz = np.random.default_rng(0).normal(size=(num, 3)).astype(np.float32)
    valid, power = np.arange(num) % 3 > 0, np.arange(num, dtype=np.float32)
    return PointCloud(*map(jnp.asarray, (xyz, valid)), power=jnp.asarray(power))


def test_ply_is_read_by_trimesh(tmp_path):
    points = cloud(30)
    write_ply(tmp_path / "new" / "a.ply", points)
    with (tmp_path / "new" / "a.ply").open("rb") as file:
        read = load_ply(file)["vertices"]
    np.testing.assert_array_equal(read, np.asarray(points.xyz)[points.valid])
    assert b"property float power" in (tmp_path / "new" / "a.ply").read_bytes()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.ply"]


def test_empty_cloud_is_a_file_without_points(tmp_path):
    write_ply(tmp_path / "a.ply", cloud(1))
    assert b"element vertex 0\n" in (tmp_path / "a.ply").read_bytes()


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    write_npz(tmp_path / "a.npz", {"x": np.ones(3)})
    before = (tmp_path / "a.npz").read_bytes()

    class Broken:
        def __array__(self, *args, **kwargs):
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_npz(tmp_path / "a.npz", {"x": np.ones(3), "y": Broken()})
    assert (tmp_path / "a.npz").read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]
