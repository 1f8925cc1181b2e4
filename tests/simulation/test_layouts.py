"""Scenes: the way through them is free, and a seed is a scene."""

import hashlib

import numpy as np
import pytest

from jradar.simulation.scenes.layouts import make_scene
from jradar.simulation.scenes.scene import cast, placements
from jradar.simulation.scenes.trajectory import pose_at
from jradar.simulation.sets import SIX

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
