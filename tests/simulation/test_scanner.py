"""LiDAR: closed-form ranges, glass, what is lost, and the pattern of each sensor."""

import numpy as np
import pytest

from jradar.simulation.rig import sensor_pose
from jradar.simulation.scanner import ScannerSpec, mid360_rays, ouster_rays, scan
from jradar.simulation.scenes.solids import box, moved, slab
from tests.simulation.worlds import wall, world

WALL = wall(6, "concrete", (-30, 30), (-9, 9))
EXACT = ScannerSpec(noise_m=0.0, fading_db=0.0, reach_m=1e4, least_range_m=0.0)


RAYS = ouster_rays()


def ranges(scene, directions=RAYS[0], seconds=RAYS[1], *, scanner=EXACT):
    random = np.random.default_rng(0)
    cloud = scan(random, scene, 0.0, directions, seconds, scanner=scanner)
    return np.linalg.norm(cloud[:, :3], axis=-1), cloud


def test_ranges_in_a_box_are_those_of_the_closed_form():
    low, high = np.array([-3.0, -4.0, 0.0]), np.array([7.0, 2.0, 3.0])
    room = moved(box((10.0, 6.0, 3.0), "concrete"), (2.0, -1.0, 0.0))
    scene, _ = world([room])
    directions, seconds = RAYS
    measured, cloud = ranges(scene)
    origin, turn = sensor_pose(scene.platform, "lidar", np.array(0.0))
    rays = directions @ turn.T
    with np.errstate(divide="ignore"):
        exits = np.maximum((low - origin) / rays, (high - origin) / rays)
    np.testing.assert_allclose(measured, exits.min(-1), atol=2e-4)
    assert cloud.dtype == np.float32 and cloud.shape == (65_536, 4)


def test_the_rig_moves_while_the_head_turns():
    scene, _ = world([WALL], speed_mps=2.0)
    still, _ = world([WALL])
    directions, seconds = RAYS
    level = np.abs(directions[:, 2]) < 0.005
    ahead = level & (directions[:, 0] < -0.999)  # the LiDAR's x axis looks back
    moving, _ = ranges(scene, directions[ahead], seconds[ahead])
    standing, _ = ranges(still, directions[ahead], seconds[ahead])
    assert ahead.sum() > 10
    np.testing.assert_allclose(standing - moving, 2.0 * seconds[ahead], atol=5e-3)


def test_glass_is_looked_through_and_metal_is_not():
    directions, seconds = RAYS
    slanted = (directions[:, 0] < -0.9) & (np.abs(directions[:, 1]) > 0.15)
    for material, expected in (("glass", 6.0), ("metal", 3.0)):
        scene, _ = world([wall(3, material, (-9, 9), (-9, 9)), WALL])
        _, cloud = ranges(scene, directions[slanted], seconds[slanted])
        origin, turn = sensor_pose(scene.platform, "lidar", np.array(0.0))
        x = (cloud[:, :3] @ turn.T + origin)[:, 0]
        np.testing.assert_allclose(x, expected, atol=1e-3)


def test_far_and_grazing_returns_are_lost_and_written_as_zeros():
    scene, _ = world([slab((-80, -80), (80, 80), 0.0, "asphalt")])
    directions, _ = RAYS
    measured, cloud = ranges(scene, scanner=ScannerSpec())
    lost = measured == 0
    assert (cloud[lost] == 0).all()
    assert lost[directions[:, 2] > 0].all()
    steep, flat = (-directions[:, 2] > 0.25), np.abs(directions[:, 2] + 0.025) < 0.025
    assert lost[steep].mean() < 0.05 and lost[flat].mean() > 0.8
    assert (cloud[~lost, 3] > 0).all()


def test_noise_is_as_specified():
    room = moved(box((8.0, 8.0, 3.0), "drywall"), (0, 0, 0))
    scene, _ = world([room])
    exact, _ = ranges(scene)
    noisy, _ = ranges(scene, scanner=ScannerSpec(least_range_m=0.0))
    heard = noisy > 0
    assert heard.mean() > 0.95
    error = (noisy - exact)[heard]
    assert abs(error.mean()) < 2e-3
    assert error.std() == pytest.approx(0.013, abs=0.003)


def test_patterns_cover_their_fields_of_view():
    directions, seconds = RAYS
    elevation = np.degrees(np.arcsin(directions[:, 2])).reshape(64, 1024)
    assert elevation[0] == pytest.approx(16.6) and elevation[-1] == pytest.approx(-16.6)
    assert seconds.max() < 0.1
    first, second = mid360_rays(0)[0], mid360_rays(1)[0]
    elevation = np.degrees(np.arcsin(first[:, 2]))
    assert -7.01 < elevation.min() < -6 and 51 < elevation.max() < 52.01
    azimuth = np.arctan2(first[:, 1], first[:, 0])
    assert np.histogram(azimuth, 36, (-np.pi, np.pi))[0].min() > 300
    cells = [{tuple(c) for c in np.round(d * 200).astype(int)} for d in (first, second)]
    assert len(cells[0] & cells[1]) < 0.6 * len(cells[0])  # not the same again
