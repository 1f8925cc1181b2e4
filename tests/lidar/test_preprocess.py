"""The whole preparation: nested masks, extrinsics, manifest, memory, real scans."""

import math
import sys

import numpy as np
import pytest

from jradar.lidar import LidarSpec, preprocess, rigid_transform, transform
from jradar.viz import preparation_figure, save_figure
from tests.lidar.rooms import BOX, CEILING, FLOOR, WALL, scan_room

pytest.importorskip("pypatchworkpp")
pytest.importorskip("sklearn")

SHELL = (-3.0, -4.0, -1.2), (9.0, 4.0, 1.6)
SEEN = (3.5, -1.4, -1.2), (4.1, -0.8, 0.6)
UNSEEN = (3.5, 1.0, -1.2), (4.1, 1.6, 0.6)
BOXES = SEEN, UNSEEN
# The radar sees one box and the wall behind both.
FAR = ([9, y, 0.1] for y in (-3, -1, 0, 1, 3))
ECHOES = np.float32([[3.5, -1.1, 0], [3.6, -0.9, 0.2], *FAR])
# A LiDAR that looks backwards, as ColoRadar's.
RADAR_FROM_LIDAR = rigid_transform(
    np.array([-0.11, -0.07, 0.06]), np.array([0, 0, math.sin(1.55), math.cos(1.55)])
)


def scan(seed=0):
    """Points in the LiDAR's frame and the surface of each, seen from the radar."""
    xyz, surface = scan_room(SHELL, BOXES, seed=seed)
    return transform(np.linalg.inv(RADAR_FROM_LIDAR), xyz), surface


def prepare(xyz, radar=ECHOES, spec=None):
    """`preprocess` with the extrinsics of this file."""
    spec = spec or LidarSpec()
    return preprocess(xyz, radar, radar_from_lidar=RADAR_FROM_LIDAR, spec=spec)


def test_what_remains_is_what_the_radar_saw():
    xyz, surface = scan()
    steps = prepare(xyz)
    assert steps.xyz.dtype == np.float32
    np.testing.assert_allclose(steps.xyz, scan_room(SHELL, BOXES)[0], atol=1e-5)
    parts = np.stack([steps.ground, steps.ceiling, steps.visible])
    assert parts.any(1).all() and (parts.sum(0) <= steps.in_view).all()
    kinds = {"floor": FLOOR, "ceiling": CEILING, "seen": BOX, "unseen": BOX + 1}
    of = {name: steps.in_view & (surface == kind) for name, kind in kinds.items()}
    assert steps.visible[of["floor"]].mean() < 0.01
    assert steps.visible[of["ceiling"]].mean() < 0.01
    assert steps.visible[of["seen"]].mean() > 0.94
    assert not steps.visible[of["unseen"]].any()
    # The back wall has echoes; its ends at floor and ceiling are cut. The side walls
    # have none, and the boxes' shadows part them from the back wall.
    x, y, z = steps.xyz.T
    wall = steps.in_view & (surface == WALL)
    back = wall & (x > 8.8) & (np.abs(y) < 3.4) & (z > -1) & (z < 1.4)
    assert steps.visible[back].mean() > 0.99
    assert not steps.visible[wall & (x < 8.5)].any()


def test_missing_returns_and_tiny_clouds_make_no_points_at_the_lidar():
    """(0, 0, 0) moved by the extrinsics would be a point beside the radar."""
    xyz, _ = scan()
    holes = np.random.default_rng(0).random(len(xyz)) < 0.2
    steps = prepare(np.where(holes[:, None], np.float32(0), xyz))
    assert np.isnan(steps.xyz[holes]).all()
    assert not steps.in_view[holes].any() and not steps.visible[holes].any()
    near = LidarSpec(min_range_m=0.0, azimuth=(-math.pi, math.pi))
    assert not prepare(np.zeros((20, 3), np.float32), spec=near).in_view.any()
    for points in (0, 1, 5):  # behind, where the LiDAR looks
        xyz = np.full((points, 3), [3.0, 0.5, 0.2], np.float32)
        steps = prepare(xyz, transform(RADAR_FROM_LIDAR, xyz[:1]), near)
        assert steps.visible.tolist() == [True] * points
        assert not prepare(xyz, np.zeros((0, 3)), near).visible.any()


@pytest.mark.parametrize("package", ["pypatchworkpp", "sklearn.cluster"])
def test_missing_package_names_its_extra(monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=r"jradar\[data\]"):
        prepare(scan()[0])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"azimuth": (1.0, -1.0)}, "lowest < highest"),
        ({"elevation": (0.1, math.nan)}, "lowest < highest"),
        ({"min_range_m": 20.0}, "nearest < farthest"),
        ({"max_range_m": math.inf}, "nearest < farthest"),
        ({"eps_m": 0.0}, "eps_m = 0.0"),
        ({"min_points": 0}, "min_points = 0"),
        ({"voxel_m": -0.1}, "voxel_m = -0.1"),
        ({"voxel_m": math.nan}, "voxel_m = nan"),
        ({"sensor_height_m": -1.0}, "sensor_height_m = -1.0"),
    ],
)
def test_impossible_parameters(wrong, message):
    with pytest.raises(ValueError, match=message):
        LidarSpec(**wrong)


def test_real_scan_with_invented_radar_points(samples):
    xyz = np.fromfile(samples / "kitti" / "000000.bin", "<f4").reshape(-1, 4)[:, :3]
    spec = LidarSpec(max_range_m=15.0)
    identity = np.eye(4)
    cars = np.float32([[7.5, -3.0, -0.9], [8.0, -2.6, -0.8], [14.5, -2.2, -1.0]])
    steps = preprocess(xyz, cars, radar_from_lidar=identity, spec=spec)
    kept = steps.xyz[steps.visible]
    assert 0.5 < steps.ground.sum() / steps.in_view.sum() < 0.75
    assert not steps.ceiling.any()
    assert len(kept) > 300 and (kept[:, 2] > -1.75).all()
    assert steps.visible.sum() < 0.5 * (steps.in_view & ~steps.ground).sum()


def test_figure_of_any_scan(tmp_path):
    from PIL import Image

    spec = LidarSpec()
    for name, steps, radar in (
        ("room", prepare(scan()[0][::5]), ECHOES),
        ("empty", prepare(np.zeros((0, 3), np.float32)), np.zeros((0, 3))),
    ):
        figure = preparation_figure(steps, radar, spec, title=name)
        above = figure.axes[0]
        assert above.xaxis_inverted()  # left is left
        shown = [len(axes.collections[1].get_offsets()) for axes in figure.axes[:5]]
        assert shown[-1] == steps.visible.sum() and shown == sorted(shown)[::-1]
        save_figure(figure, tmp_path / f"{name}.png")
        assert min(Image.open(tmp_path / f"{name}.png").size) > 400
