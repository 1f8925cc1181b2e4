"""Voxels to surfaces: flat walls where they stood, the rest where it was."""

import numpy as np
import pytest

from jradar.recordings.coloradar.maps import VOXEL_M, MapRun
from jradar.simulation.paths.reflectors import find_reflectors
from jradar.simulation.scenes.materials import MATERIAL_IDS
from jradar.simulation.scenes.scene import Scene, cast, make_body, placements
from jradar.simulation.scenes.voxels import surfaces
from tests.programs import finished
from tests.simulation.worlds import straight

pytest.importorskip("embreex", reason="the extra `sim` is not installed")
MATERIALS = {"floors": ("floor",), "walls": ("concrete",), "others": ("metal",)}


def occupied(points):
    """The centres of the voxels that hold points."""
    return (np.unique(np.floor(points / VOXEL_M).astype(int), axis=0) + 0.5) * VOXEL_M


def test_a_slanted_wall_and_a_floor_become_flat_mirrors():
    random = np.random.default_rng(0)
    u, v = random.uniform(-3, 3, 60_000), random.uniform(0, 2.5, 60_000)
    normal = np.array([np.cos(0.4), np.sin(0.4), 0])
    along = np.array([-np.sin(0.4), np.cos(0.4), 0])
    wall = 4.0 * normal + u[:, None] * along + v[:, None] * [0, 0, 1]
    floor = np.stack([u, random.uniform(-3, 3, 60_000), 0 * u], -1)
    solid = surfaces(random, occupied(np.concatenate([wall, floor])), VOXEL_M,
                     **MATERIALS)  # fmt: skip
    body = make_body(random, solid)
    scene = Scene("map", (body,), straight())
    rays = normal + random.uniform(-0.4, 0.4, (200, 1)) * along
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    hits = cast(scene, placements(scene, 0.0), np.tile([0, 0, 1.2], (200, 1)), rays)
    apart = hits.distance * (rays @ normal)
    assert np.isfinite(apart).all()
    assert np.abs(apart - 4.0).max() < 0.1 and apart.std() < 0.03
    facets = find_reflectors((body,)).facets[0]
    large = facets.area_m2 > 2.0
    wall_like = np.abs(facets.normal[large] @ normal) > np.cos(0.05)
    floor_like = np.abs(facets.normal[large][:, 2]) > np.cos(0.05)
    assert (wall_like | floor_like).all() and wall_like.any() and floor_like.any()
    assert facets.area_m2[large][wall_like].sum() == pytest.approx(15.0, rel=0.15)
    level = np.abs(body.normals[:, 2]) > 0.9
    assert (solid.material[level] == MATERIAL_IDS["floor"]).mean() > 0.95


def test_scattered_voxels_stay_where_they_are():
    random = np.random.default_rng(1)
    centres = occupied(random.uniform(-4, 4, (300, 3)))
    solid = surfaces(random, centres, VOXEL_M, **MATERIALS)
    assert len(solid.faces) == len(centres)
    middle = solid.vertices[solid.faces].mean(1)
    apart = np.linalg.norm(middle[:, None] - centres, axis=-1).min(1)
    assert apart.max() < 2.5 and set(solid.material) == {MATERIAL_IDS["metal"]}


SURFACES_ON = """
import os
os.environ["OPENBLAS_CORETYPE"] = {processor!r}
import zlib
import numpy as np
from jradar.simulation.scenes.voxels import surfaces
random = np.random.default_rng(3)
x, y, z = random.uniform(-3, 3, (3, 40_000))
near = random.normal(0, 0.1, 40_000)
wall, floor = np.stack([x, 2 + 0.3 * x + near, z], -1), np.stack([x, y, near], -1)
voxels = np.unique(np.floor(np.concatenate([wall, floor]) / 0.15).astype(int), axis=0)
solid = surfaces(
    random,
    (voxels + 0.5) * 0.15,
    0.15,
    floors=("floor", "grass"),
    walls=("concrete", "metal", "wood"),
    others=("metal", "plastic"),
)
vertices = solid.vertices.round(5) + 0.0  # no negative zeros
print(len(vertices), zlib.crc32(vertices.tobytes()), zlib.crc32(solid.material))
"""


@pytest.mark.slow
def test_surfaces_are_the_same_on_processors_that_round_differently():
    first, second = (
        finished(SURFACES_ON.format(processor=name)).stdout
        for name in ("Haswell", "Prescott")  # of OpenBLAS, on x86-64
    )
    assert first and first == second


def test_the_place_of_a_patch_is_the_centre_of_its_circle():
    random = np.random.default_rng(2)
    lidar = np.unique(random.integers(-60, 60, (6000, 3)), axis=0).astype(np.int16)
    centre = np.array([1.7, -2.2])
    xy = (lidar[:, :2] + 0.5) * VOXEL_M
    inside = np.linalg.norm(xy - centre, axis=1) < 3.0
    # Part of this circle lies beyond the map.
    edge = np.linalg.norm(xy - [7.0, 3.0], axis=1) < 4.0
    bits = np.packbits([inside, edge], axis=1)
    run = MapRun("lab_run1", lidar, lidar, bits, bits)
    np.testing.assert_allclose(run.place(0), centre, atol=0.1)
    np.testing.assert_allclose(run.place(1), [7.0, 3.0], atol=0.3)
