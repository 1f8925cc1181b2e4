"""Scenes: the way through them is free, and a seed is a scene."""

import hashlib

import numpy as np
import pytest

from jradar.simulation.scenes.layouts import make_scene
from jradar.simulation.scenes.scene import ROOM_M, cast, placements
from jradar.simulation.scenes.solids import person
from jradar.simulation.scenes.trajectory import pose_at
from jradar.simulation.sets import SIX
from tests.simulation.worlds import straight, wall, world

pytest.importorskip("embreex", reason="the extra `sim` is not installed")

FIRST = {
    "hallways": "da0d3b16c8f43d06",
    "mine": "7f0f4948b0f9173a",
    "lab": "2b8b72b179c514fb",
    "outdoor": "e2138d6831d4d302",
    "corridor": "d09178d1efc97e94",
    "hall": "b4fd03148112c989",
}


def digest(scene):
    total = hashlib.sha256()
    for body in scene.bodies:
        for array in (body.solid.vertices, body.points, body.reflectivity):
            total.update(np.round(array, 9).tobytes())
    return total.hexdigest()[:16]


@pytest.mark.parametrize("family", ["home", "warehouse", "plantroom"])
def test_nothing_stands_in_the_way(family):
    around = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rays = np.stack([np.cos(around), np.sin(around), 0 * around], -1)
    for seed in range(4):
        scene = make_scene(family, seed)
        world = scene._replace(bodies=scene.bodies[:1])
        seconds = scene.platform.length_m / scene.platform.speed_mps
        xyz, _ = pose_at(scene.platform, np.linspace(0, seconds, 50))
        starts, ways = np.repeat(xyz, len(rays), 0), np.tile(rays, (len(xyz), 1))
        hits = cast(world, placements(world, 0.0), starts, ways)
        assert hits.distance.min() > 0.3
        assert np.median(hits.distance) < 12  # a place indoors


@pytest.mark.parametrize("family", ["home", "warehouse", "plantroom"])
def test_a_seed_is_a_scene(family):
    assert digest(make_scene(family, 1)) == digest(make_scene(family, 1))
    assert digest(make_scene(family, 1)) != digest(make_scene(family, 2))


def test_scenes_of_the_first_sets_stay_what_they_were():
    found = {family: digest(make_scene(family, 3)) for family in SIX}
    assert found == FIRST


def test_nobody_walks_through_the_radar():
    way = straight(1.0)._replace(speed_mps=-1.0)  # the same path, head on
    scene, _ = world([wall(9.0, "metal")], movers=[(person(1.8), way)], speed_mps=1.0)
    starts = np.zeros((1, 3)) + [0, 0, 1.2]
    for time in np.linspace(-1.0, 1.0, 80):
        (sensors, _), (plain, turn) = (pose_at(t, time) for t in (scene.platform, way))
        place = placements(scene, time)[1]
        if np.linalg.norm((plain - sensors)[:2]) >= ROOM_M:
            np.testing.assert_array_equal(place.xyz, plain)
        else:
            assert place.xyz[2] < -900
            hits = cast(scene, placements(scene, time), starts, np.array([[1.0, 0, 0]]))
            assert hits.distance[0] == pytest.approx(9.0) and hits.body[0] == 0
        np.testing.assert_array_equal(place.turn, turn)
