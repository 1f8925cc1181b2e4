"""Layouts of columns: units that follow from the values."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.lidar import transform
from jradar.recordings import Stream
from jradar.recordings.points.fields import FORWARD, Layout
from jradar.recordings.points.frames import points_recording

POLAR = {"range": "r", "azimuth": "a", "elevation": "e"}
PLACE = {"x": "x", "y": "y", "z": "z"}


def columns(**given):
    return {name: np.asarray(values, float) for name, values in given.items()}


def layout(fields, frame, **options):
    return Layout.of(fields, [frame], **options)


@pytest.mark.parametrize(("angle", "unit"), [(30.0, "degrees"), (np.pi / 6, "radians")])
def test_angles_beyond_pi_are_in_degrees(angle, unit):
    frame = columns(r=[10.0], a=[angle], e=[0.0])
    found = layout(POLAR, frame)
    np.testing.assert_allclose(
        found.cloud(frame).xyz, [[10 * np.cos(np.pi / 6), 5.0, 0.0]], atol=1e-5
    )
    assert unit in found.describe()["place"]


def test_a_point_at_the_origin_is_a_missing_one():
    frame = columns(x=[1.0, 0.0, 3.0], y=[0.0, 0.0, 1.0], z=[0.0, 0.0, np.nan])
    cloud = layout(PLACE, frame, forward="x").cloud(frame)
    np.testing.assert_array_equal(cloud.xyz, [[1.0, 0.0, 0.0]])


@pytest.mark.parametrize(("most", "expected"), [(30.0, 1000.0), (3000.0, 3000.0)])
def test_powers_of_200_or_less_are_in_decibels(most, expected):
    frame = columns(x=[5.0, 6.0], y=[1.0, 1.0], z=[0.0, 0.0], p=[10.0, most])
    cloud = layout({**PLACE, "power": "p"}, frame, forward="x").cloud(frame)
    np.testing.assert_allclose(cloud.power[-1], expected, rtol=1e-5)


def test_velocities_of_what_comes_nearer_are_negative():
    frame = columns(x=[5.0], y=[0.0], z=[0.0], v=[2.0])
    fields = {**PLACE, "velocity": "v"}
    for approaching in (False, True):
        found = layout(fields, frame, forward="x", approaching=approaching)
        assert found.cloud(frame).velocity[0] == (-2.0 if approaching else 2.0)


@pytest.mark.parametrize("forward", FORWARD)
def test_a_mount_of_the_files_axes_is_one_of_jradars(forward):
    rng = np.random.default_rng(0)
    frame = columns(**dict(zip("xyz", rng.uniform(1, 5, (3, 40)), strict=True)))
    mount = np.eye(4)
    mount[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix()
    mount[:3, 3] = 0.1, 0.2, 0.3
    found = points_recording(
        Path("walk"),
        Stream([frame].__getitem__, 1),
        forward=forward,
        base_from_radar=mount,
    )
    in_file = np.stack([*frame.values()], -1)
    np.testing.assert_allclose(
        transform(found.base_from_radar, np.asarray(found.points[0].xyz)),
        transform(mount, in_file),
        atol=1e-5,
    )
