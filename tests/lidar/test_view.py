"""What the radar could see, and scans of one place in one frame."""

import numpy as np
import pytest

from jradar.lidar import returns, rigid_transform, shared_field_of_view, transform
from jradar.lidar.align import accumulate
from jradar.range_image import ImageSpec, pixel_of

VIEW = {"azimuth": (-1.0, 0.8), "elevation": (-0.3, 0.35), "max_range_m": 9.0}


def test_view_is_the_range_images():
    rng = np.random.default_rng(0)
    xyz = rng.uniform(-12, 12, (60_000, 3)).astype(np.float32)
    spec = ImageSpec(2000, 4000, **VIEW)
    inside = shared_field_of_view(xyz, **VIEW, min_range_m=0.0)
    expected = np.asarray(pixel_of(xyz, spec)[-1])
    assert 500 < inside.sum() < 3000
    # Points within a rounding of an edge may differ.
    assert (inside != expected).sum() <= 2


def test_edges_are_half_open_and_missing_returns_are_nowhere():
    quarter = np.pi / 4
    view = {"azimuth": (-quarter, quarter), "elevation": (-quarter, quarter)}
    inside = {
        (1.0, -1.0, 0.0): True,  # lowest azimuth
        (1.0, 1.0, 0.0): False,  # highest azimuth
        (1.0, 0.0, 1.0): True,  # highest elevation
        (1.0, 0.0, -1.0): False,  # lowest elevation
        (4.0, 0.0, 0.0): True,  # farthest
        (4.000001, 0.0, 0.0): False,
        (0.5, 0.0, 0.0): True,  # nearest
        (0.499, 0.0, 0.0): False,
        (-1.0, 0.0, 0.0): False,  # behind
        (2.3, 1.9, -2.5): True,  # 0.69 rad to the left and below, at 3.9 m
    }
    limits = {"max_range_m": 4.0, "min_range_m": 0.5}
    found = shared_field_of_view(np.array([*inside]), **view, **limits)
    assert found.tolist() == [*inside.values()]
    bad = np.array([[0, 0, 0], [np.nan, 1, 1], [np.inf, 0, 0], [-np.inf, np.nan, 0]])
    assert not returns(bad).any() and returns(np.array([[0, 0, 1e-3]])).all()
    assert not shared_field_of_view(bad, **view, max_range_m=4.0, min_range_m=0.0).any()


def test_scans_of_a_moving_sensor_fall_onto_one_another():
    rng = np.random.default_rng(1)
    world = rng.uniform(-5, 5, (40, 3))
    xyz, quaternion = rng.normal(size=(3, 3)), rng.normal(size=(3, 4))
    world_from_sensor = rigid_transform(xyz, quaternion)
    scans = [
        np.concatenate([transform(np.linalg.inv(pose), world), np.zeros((2, 3))])
        for pose in world_from_sensor
    ]
    last_from_each = np.linalg.inv(world_from_sensor[2]) @ world_from_sensor
    cloud = accumulate(scans, last_from_each)
    assert len(cloud) == 120  # without the missing returns
    np.testing.assert_allclose(cloud, np.tile(scans[2][:40], (3, 1)), atol=1e-9)


def test_scans_outside_the_trajectory_are_left_out():
    scans = [np.ones((3, 3), np.float32), np.full((2, 3), 2, np.float32)]
    transforms = np.stack([np.full((4, 4), np.nan), np.eye(4)])
    cloud = accumulate(scans, transforms)
    assert cloud.dtype == np.float32 and (cloud == 2).all() and len(cloud) == 2
    assert accumulate(scans[:1], transforms[:1]).shape == (0, 3)
    assert accumulate([], np.zeros((0, 4, 4))).shape == (0, 3)
    with pytest.raises(ValueError, match="2 scans and 1 transforms"):
        accumulate(scans, transforms[:1])
