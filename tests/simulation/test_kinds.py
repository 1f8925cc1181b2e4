"""Layouts without a template: the way is free, objects have the sizes they claim."""

import numpy as np
import pytest

from jradar.simulation.scenes import objects
from jradar.simulation.scenes.kinds import KINDS, TUNNEL, draw_plan, draw_way
from jradar.simulation.scenes.layouts import make_scene
from jradar.simulation.scenes.scene import cast, placements
from jradar.simulation.scenes.trajectory import pose_at
from tests.simulation.test_layouts import digest
from tests.simulation.worlds import world

AROUND = np.linspace(0, 2 * np.pi, 24, endpoint=False)
RAYS = np.stack([np.cos(AROUND), np.sin(AROUND), 0 * AROUND], -1)


@pytest.mark.parametrize("kind", [*KINDS, TUNNEL])
def test_nothing_stands_in_the_way(kind):
    for seed in range(3):
        scene = make_scene(kind, seed)
        seconds = scene.platform.length_m / scene.platform.speed_mps
        xyz, _ = pose_at(scene.platform, np.linspace(0, seconds, 30))
        starts, ways = np.repeat(xyz, len(RAYS), 0), np.tile(RAYS, (len(xyz), 1))
        still = scene._replace(bodies=scene.bodies[:1])
        hits = cast(still, placements(still, 0.0), starts, ways)
        assert hits.distance.min() > 0.25
    assert digest(make_scene(kind, 1)) == digest(make_scene(kind, 1))
    assert digest(make_scene(kind, 1)) != digest(make_scene(kind, 2))


def test_sizes_and_openness_vary():
    """Rooms of 3 to 25 m, some of whose horizon is open."""
    spans, shares = [], []
    for seed in range(24):
        scene = make_scene("room", seed)
        xyz, _ = pose_at(scene.platform, 0.0)
        still = scene._replace(bodies=scene.bodies[:1])
        starts = np.broadcast_to(xyz, RAYS.shape)
        hits = cast(still, placements(still, 0.0), starts, RAYS)
        spans.append(np.ptp(scene.bodies[0].solid.vertices[:, 0]))
        shares.append(np.isfinite(hits.distance).mean())
    assert min(spans) < 7 and max(spans) > 18
    assert min(shares) < 0.8 and np.median(shares) > 0.7


def test_a_plan_of_three_metres_has_a_way_inside():
    for seed in range(20):
        random = np.random.default_rng(seed)
        plan = draw_plan(random, 3.0, 3.0)
        way = draw_way(random, plan)
        assert np.abs(way - plan.mean(0)).max() < 1.8


def seen(solid, rays, start=(-3.0, 0.0, 1.0)):
    scene, _ = world([solid])
    starts = np.broadcast_to(np.array(start), rays.shape)
    return cast(scene, placements(scene, 0.0), starts, rays).distance


def test_a_pillar_is_as_wide_as_its_rays():
    random = np.random.default_rng(0)
    pillar = next(p for p in iter(lambda: objects.pillar(random), None)
                  if len(p.faces) > 12 and np.ptp(p.vertices[:, 2]) > 1.5)  # fmt: skip
    angle = np.linspace(-0.4, 0.4, 4001)
    rays = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    hit = np.isfinite(seen(pillar, rays))
    radius = np.ptp(pillar.vertices[:, 1]) / 2
    expected = 2 * np.arcsin(radius / 3.0)
    assert np.ptp(angle[hit]) == pytest.approx(expected, rel=0.03)


def test_a_beam_hangs_at_its_height():
    random = np.random.default_rng(3)
    for _ in range(5):
        portal = objects.portal(random)
        under = portal.vertices[:8, 2].min()
        slopes = np.linspace(-0.3, 0.6, 2001)
        rays = np.stack([np.ones_like(slopes), 0 * slopes, slopes], -1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        turned = portal._replace(vertices=portal.vertices[:, [1, 0, 2]])
        front = 3.0 + turned.vertices[:8, 0].min()
        hit = np.isfinite(seen(turned, rays))
        lowest = 1.0 + slopes[hit].min() * front
        if under > 1.0:  # seen from below its edge
            assert lowest == pytest.approx(under, abs=0.2)
        assert hit.any()
