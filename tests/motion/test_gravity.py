"""Mounts that gravity contradicts are named; those that agree are not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.motion import gravity_warnings
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Imu, Recording, Stream


def turned(roll=0.0, pitch=0.0):
    mount = np.eye(4)
    rotation = Rotation.from_euler("xyz", [roll, pitch, 0], degrees=True)
    mount[:3, :3] = rotation.as_matrix()
    return mount


def rig(tmp_path, *, true_imu, imu, radar, strength=9.81):
    """A rig on a walk, level on the mean; `true_imu` is how its IMU really sits."""
    random = np.random.default_rng(0)
    force = [0, 0, strength] + random.normal(0, 2.0, (500, 3))
    felt = force @ true_imu[:3, :3]
    records = Imu(np.arange(500) * 0.01, felt, np.zeros((500, 3)))
    parts = {"imu": records, "base_from_radar": radar, "base_from_imu": imu}
    spec, cubes = RadarSpec.awr1843(), Stream([].__getitem__, 0)
    return Recording("rig", tmp_path, Radar(spec), cubes, **parts)


UPRIGHT, DOWN, ASIDE = turned(), turned(roll=178), turned(roll=90)
TILTED = turned(pitch=30)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"true_imu": TILTED, "imu": TILTED, "radar": TILTED}, ""),
        ({"true_imu": DOWN, "imu": DOWN, "radar": UPRIGHT}, ""),
        ({"true_imu": UPRIGHT, "imu": UPRIGHT, "radar": DOWN}, "mounted upside down"),
        ({"true_imu": UPRIGHT, "imu": UPRIGHT, "radar": ASIDE}, "lies on its side"),
        ({"true_imu": DOWN, "imu": UPRIGHT, "radar": UPRIGHT}, "z axis of the base"),
        ({"true_imu": DOWN, "imu": None, "radar": None}, "IMU is upside down"),
        ({"true_imu": UPRIGHT, "imu": None, "radar": None}, ""),
        (
            {"true_imu": UPRIGHT, "imu": UPRIGHT, "radar": DOWN, "strength": 3},
            "shows no vertical",
        ),
    ],
)
def test_mounts_that_gravity_contradicts_are_named(tmp_path, options, message):
    found = gravity_warnings(rig(tmp_path, **options))
    assert len(found) == bool(message) and message in "".join(found)
    if "mounted upside" in message or "IMU is" in message:
        assert "upside_down = true" in found[0]
    without = rig(tmp_path, **options)._replace(imu=None)
    assert gravity_warnings(without) == ()
