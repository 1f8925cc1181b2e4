"""Clouds to files: independent readers get the valid points back; empty clouds."""

import csv

import jax.numpy as jnp
import numpy as np
import pytest
from trimesh.exchange.ply import load_ply

from jradar.errors import UsageError
from jradar.outputs.clouds import CLOUD_WRITERS, write_npz, write_ply
from jradar.recordings import read_cloud
from jradar.types import PointCloud


def cloud(num):
    rng = np.random.default_rng(0)
    xyz = rng.normal(size=(num, 3)).astype(np.float32)
    valid, power = np.arange(num) % 3 > 0, 1e9 * rng.random(num, np.float32)
    columns = {"velocity": -xyz[:, 0], "power": power}
    columns = {k: jnp.asarray(v) for k, v in columns.items()}
    return PointCloud(jnp.asarray(xyz), valid, **columns)


def test_ply_is_read_by_trimesh(tmp_path):
    points = cloud(30)
    write_ply(tmp_path / "new" / "a.ply", points)
    with (tmp_path / "new" / "a.ply").open("rb") as file:
        read = load_ply(file)["vertices"]
    np.testing.assert_array_equal(read, np.asarray(points.xyz)[points.valid])
    assert b"property float power" in (tmp_path / "new" / "a.ply").read_bytes()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.ply"]


@pytest.mark.parametrize("kind", CLOUD_WRITERS)
def test_every_format_gives_all_numbers_back(tmp_path, kind):
    points, path = cloud(30), tmp_path / f"a.{kind}"
    CLOUD_WRITERS[kind](path, points)
    if kind == "csv":
        with path.open(newline="") as file:
            names, *rows = csv.reader(file)
        read = dict(zip(names, np.array(rows, np.float32).T, strict=True))
    else:
        read = read_cloud(path)
    assert [*read] == ["x", "y", "z", "velocity", "power"]
    valid, xyz = np.asarray(points.valid), np.asarray(points.xyz)
    np.testing.assert_array_equal(np.stack([read[k] for k in "xyz"], 1), xyz[valid])
    for name in ("velocity", "power"):
        column = np.asarray(getattr(points, name))[valid]
        np.testing.assert_array_equal(read[name], column)


def test_the_header_of_a_pcd_file_is_in_the_order_of_pcl(tmp_path):
    CLOUD_WRITERS["pcd"](tmp_path / "a.pcd", cloud(4))
    head, _, points = (tmp_path / "a.pcd").read_bytes().partition(b"DATA binary\n")
    words = [line.split()[0] for line in head.splitlines()[1:]]
    expected = b"VERSION FIELDS SIZE TYPE COUNT WIDTH HEIGHT VIEWPOINT POINTS"
    assert words == expected.split() and b"WIDTH 2\nHEIGHT 1\n" in head
    assert len(points) == 2 * 5 * 4


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_notes_are_comments_that_readers_skip(tmp_path, kind):
    notes = ["9% of its points may be right", "do not trust\nframe 1"]
    CLOUD_WRITERS[kind](tmp_path / f"a.{kind}", cloud(4), notes)
    lines = (tmp_path / f"a.{kind}").read_bytes().split(b"\n")
    mark = b"comment " if kind == "ply" else b"# "
    assert mark + b"9% of its points may be right" in lines
    assert mark + b"do not trust\\nframe 1" in lines
    assert len(read_cloud(tmp_path / f"a.{kind}")["x"]) == 2


@pytest.mark.parametrize("kind", ["ply", "pcd"])
def test_an_empty_cloud_is_a_file_without_points(tmp_path, kind):
    CLOUD_WRITERS[kind](tmp_path / f"a.{kind}", cloud(1))
    columns = read_cloud(tmp_path / f"a.{kind}")
    assert [len(column) for column in columns.values()] == [0] * 5


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


def test_a_cloud_is_saved_in_the_format_of_its_suffix(tmp_path):
    points = cloud(6)
    for suffix in (".ply", ".pcd"):
        points.save(tmp_path / f"a{suffix}")
        assert len(read_cloud(tmp_path / f"a{suffix}")["x"]) == points.valid.sum()
    points.save(tmp_path / "a.npz")
    np.testing.assert_array_equal(
        np.load(tmp_path / "a.npz")["xyz"], points.xyz[points.valid]
    )
    with pytest.raises(UsageError, match=r"a\.las: expected .* \.ply, \.pcd, \.csv"):
        points.save(tmp_path / "a.las")
    with pytest.raises(ValueError, match="expected one cloud"):
        PointCloud(points.xyz[None], points.valid[None]).save(tmp_path / "b.ply")
