"""Floor and ceiling: known rooms, a tilted sensor, real roads, no memory, no noise."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jradar.lidar import shared_field_of_view
from jradar.lidar.ground import ceiling_mask, floor_plane, ground_mask
from tests.lidar.rooms import BOX, CEILING, FLOOR, WALL, scan_room

pytest.importorskip("pypatchworkpp")

VIEW = {"azimuth": (-math.pi / 3, math.pi / 3), "max_range_m": 12.0}
VIEW |= {"elevation": (-math.pi / 9, math.pi / 9)}
OVERHEAD = {"elevation": np.radians(np.linspace(-60, 60, 96))}
SPARSE = {"elevation": np.radians(np.linspace(-15, 15, 16)), "columns": 1800}
NOISE_M = 0.02


def furnished(height, top):
    """A room, and a table, a pillar and a crate in it; the sensor at `height`."""
    table = (2.5, -2.0, 0.7 - height), (4.0, -1.0, 0.75 - height)
    pillar = (5.0, 1.0, -height), (5.4, 1.4, top)
    crate = (3.0, 2.0, -height), (3.6, 2.6, 0.5 - height)
    return ((-3.0, -4.0, -height), (9.0, 4.0, top)), (table, pillar, crate)


ROOMS = {  # height of sensor and ceiling above it
    "hand-held": (1.2, 1.6, {}),
    "on a robot": (0.5, 2.2, {}),
    "on a mast": (1.7, 1.0, {}),
    "tilted": (1.2, 1.6, {"tilt": (0.08, -0.12)}),
    "wide": (1.2, 1.6, OVERHEAD),
    "16 beams": (1.2, 1.6, SPARSE),
    "noisier": (1.2, 1.6, {"noise_m": 0.03}),
}


def room(**options):
    """A furnished room around a sensor at 1.2 m: its points and their surfaces."""
    return scan_room(*furnished(1.2, 1.6), **options)


@pytest.mark.parametrize("name", ROOMS)
def test_floor_and_ceiling_go_and_the_rest_stays(name):
    height, top, options = ROOMS[name]
    xyz, surface = scan_room(*furnished(height, top), **{"noise_m": NOISE_M} | options)
    view = shared_field_of_view(xyz, **VIEW)
    ground = ground_mask(xyz, among=view)
    ceiling = ceiling_mask(xyz, among=view & ~ground)
    assert not (ground | ceiling)[~view].any()
    assert ground[view & (surface == FLOOR)].mean() > 0.99
    assert ceiling[view & (surface == CEILING)].mean() > 0.99
    flat = ground | ceiling
    assert not flat[view & (surface == BOX)].any()  # the table's top
    if "tilt" not in options:
        # What stands up loses no more than its ends at the floor and at the ceiling.
        standing = view & np.isin(surface, [WALL, BOX + 1, BOX + 2])
        ends = 0.12 + 3 * options.get("noise_m", NOISE_M)
        middle = (xyz[:, 2] > ends - height) & (xyz[:, 2] < top - ends)
        # One beam alone on a far wall looks as flat as a floor.
        assert flat[standing & middle].mean() < (0.05 if name == "16 beams" else 0.01)
        assert flat[view & (surface == WALL)].mean() < 0.15


def test_height_and_tilt_are_found():
    xyz, _ = room(tilt=(0.08, -0.12))
    plane = floor_plane(xyz)
    # The rows of the sensor's attitude are the world's axes in its own frame.
    expected = [math.sin(0.12), math.sin(0.08), math.cos(0.08)] * np.array(
        [1, math.cos(0.12), math.cos(0.12)]
    )
    np.testing.assert_allclose(plane.normal, expected, atol=4e-3)
    assert plane.height_m == pytest.approx(1.2, abs=0.01)


def test_a_known_height_replaces_the_search():
    xyz, surface = room()
    ground = ground_mask(xyz, sensor_height_m=1.2)
    assert ground[surface == FLOOR].mean() > 0.9
    assert not ground[surface == BOX].any()
    # Where that height is wrong by a metre, the floor is not where it should be.
    assert ground_mask(xyz, sensor_height_m=2.5)[surface == FLOOR].mean() < 0.05


def test_no_floor_without_a_level_surface():
    shell = (-6, -6, -30), (6, 6, 30)  # a shaft: floor and ceiling are out of reach
    xyz, _ = scan_room(shell)
    assert floor_plane(xyz) is None
    assert not ground_mask(xyz).any() and not ceiling_mask(xyz).any()


def test_ceiling_is_the_floor_upside_down():
    xyz, _ = room()
    flipped = xyz * np.float32([1, 1, -1])
    np.testing.assert_array_equal(ceiling_mask(xyz), ground_mask(flipped))


@pytest.mark.parametrize(
    "xyz",
    [
        np.zeros((0, 3)),
        np.zeros((50, 3)),
        np.full((50, 3), np.nan),
        np.array([[3.0, 0.0, -1.0]]),
        np.tile([3.0, 0.0, -1.0], (500, 1)),
        np.array([[np.inf, 0.0, -1.0], [1e20, 1.0, -1.0]]),
    ],
    ids=["empty", "missing", "NaN", "one", "one place", "infinite"],
)
def test_clouds_without_a_floor(xyz):
    for cloud in (xyz, xyz.astype(np.float32)):
        assert floor_plane(cloud) is None
        for mask in (ground_mask(cloud), ceiling_mask(cloud)):
            assert mask.dtype == bool and mask.shape == (len(xyz),) and not mask.any()
        assert ground_mask(cloud, sensor_height_m=1.0).shape == (len(xyz),)


def test_missing_returns_do_not_disturb():
    xyz, _ = room()
    holes = np.random.default_rng(0).random(len(xyz)) < 0.3
    expected = ground_mask(xyz[~holes])
    for missing in (0.0, np.nan):
        damaged = np.where(holes[:, None], np.float32(missing), xyz)
        np.testing.assert_array_equal(ground_mask(damaged)[~holes], expected)
        assert not ground_mask(damaged)[holes].any()


def test_earlier_calls_and_threads_change_nothing_and_nothing_is_printed(capfd):
    hall = (-12, -2, -0.6), (12, 2, 2.4)
    clouds = [room(columns=128, seed=s)[0] for s in range(3)]
    clouds[1:1] = [scan_room(hall, columns=128, seed=s)[0] for s in range(3)]
    alone = [ground_mask(cloud) for cloud in clouds]
    with ThreadPoolExecutor(4) as threads:
        together = [*threads.map(ground_mask, clouds[::-1])][::-1]
    np.testing.assert_array_equal(together, alone)
    print("a report")
    assert capfd.readouterr().out == "a report\n"


def test_kitti_road(samples):
    xyz = np.fromfile(samples / "kitti" / "000001.bin", "<f4").reshape(-1, 4)[:, :3]
    ground = ground_mask(xyz, max_range_m=80.0)
    assert 0.5 < ground.mean() < 0.65  # about 58 % by Patchwork++ tuned for this car
    near = ground & (np.hypot(xyz[:, 0], xyz[:, 1]) < 10)
    assert np.median(xyz[near, 2]) == pytest.approx(-1.75, abs=0.1)
    assert not ceiling_mask(xyz, max_range_m=80.0).any()


def test_ouster_scan_that_sees_no_floor(samples):
    xyz = np.load(samples / "ouster" / "os1_64_scan.npz")["xyz"].reshape(-1, 3)
    assert not ground_mask(xyz).any()


def test_real_room_with_a_low_ceiling(samples):
    import trimesh

    path = samples / "ply" / "target.ply"
    xyz = np.asarray(trimesh.load(path).vertices, np.float32)
    ground, ceiling = ground_mask(xyz), ceiling_mask(xyz)
    assert ground.sum() > 5000 and ceiling.sum() > 5000
    plane = floor_plane(xyz)
    height = xyz @ plane.normal + plane.height_m
    assert np.abs(height[ground]).mean() < 0.1
    assert np.median(height[ceiling]) == pytest.approx(2.5, abs=0.2)
