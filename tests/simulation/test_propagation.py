"""Paths: places, powers and velocities that follow by hand, and what is detected."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import Radar, RadarSpec, calibrate, radar_points
from jradar.simulation.hardware.hardware import Hardware, make_hardware, sample_frame
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.propagation import radar_paths
from jradar.simulation.paths.reflectors import find_reflectors
from jradar.simulation.rig import sensor_pose, viewpoint
from jradar.simulation.scenes.layouts import FAMILIES, make_scene
from jradar.simulation.scenes.materials import MATERIAL_IDS, MATERIALS, slab_shares
from jradar.simulation.scenes.scene import make_body
from jradar.simulation.scenes.solids import boulder, box, join, moved, sheet, slab
from jradar.simulation.scenes.trajectory import pose_at, velocity_at
from tests.simulation.worlds import corner_reflector, straight, wall, world

RADAR = RadarSpec.awr1843()
ONES = np.ones((3, 4), complex)
PERFECT = Hardware(np.zeros((3, 4, 128), complex), np.zeros((3, 4)), ONES)


def paths_of(scene, reflectors, time_s=0.0):
    return radar_paths(scene, reflectors, "single_chip", time_s, RADAR)


def samples_of(paths, key=0):
    """The frame of a perfect radar, `[.., part]`."""
    return np.asarray(sample_frame(jax.random.key(key), paths, PERFECT, RADAR))


def cloud_of(paths):
    frame = samples_of(paths).astype(np.float32)
    cloud = radar_points(jnp.asarray(frame[..., 0] + 1j * frame[..., 1]), Radar(RADAR))
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)], np.asarray(cloud.velocity)


def person(place, radius=0.15):
    """A rough target."""
    return moved(boulder(np.random.default_rng(1), radius, "person"), place)


def angles_deg(xyz):
    x, y, z = xyz
    return np.degrees([np.arctan2(y, x), np.arcsin(z / np.linalg.norm(xyz))])


def in_radar(scene, xyz):
    view = viewpoint(scene.platform, "single_chip", 0.0)
    return (np.asarray(xyz, float) - view.xyz) @ view.turn, view


def test_a_corner_reflector_is_detected_where_it_is():
    place = (6.0, 2.0, 0.8)  # it opens upwards
    scene, reflectors = world([corner_reflector(place)], speed_mps=1.0)
    xyz, velocity = cloud_of(paths_of(scene, reflectors))
    expected, view = in_radar(scene, place)
    distance = np.linalg.norm(expected)
    assert np.linalg.norm(xyz[0]) == pytest.approx(distance, abs=0.05)
    error = np.abs(angles_deg(xyz[0]) - angles_deg(expected))
    assert error[0] < 1.0 and error[1] < 2.0
    approach = -(expected @ view.turn.T) @ view.velocity / distance
    assert approach < -0.8
    assert velocity[0] == pytest.approx(approach, abs=0.03)


def test_a_rough_target_falls_with_the_fourth_power_and_a_wall_with_the_second():
    distances, powers, walls = np.array([3.0, 4.0, 5.5, 7.0, 9.0, 12.0]), [], []
    for distance in distances:
        scene, reflectors = world([person((distance, 0.0, 1.1))])
        powers.append(paths_of(scene, reflectors).power.sum())
        scene, reflectors = world([wall(distance, "metal")])
        walls.append(paths_of(scene, reflectors).power.max())
    view, _ = in_radar(scene, (0, 0, 0))
    away = np.log(distances + view[0])
    assert np.polyfit(away, np.log(powers), 1)[0] == pytest.approx(-4, abs=0.1)
    assert np.polyfit(away, np.log(walls), 1)[0] == pytest.approx(-2, abs=0.02)
    # Friis over twice the distance, losses and the reflection of metal included.
    metres = 2 * (distances[0] + view[0])
    friis_db = LINK.transmit_dbm + 2 * LINK.gain_dbi - LINK.losses_db
    friis_db += 20 * np.log10(RADAR.wavelength_m / (4 * np.pi * metres))
    assert 10 * np.log10(walls[0]) == pytest.approx(friis_db, abs=0.6)


def test_a_mirror_makes_ghosts_behind_itself_and_half_way():
    lump = person((5.0, 1.0, 1.1))
    aside = [(-1, -1.5, -2), (9, -1.5, -2), (9, -1.5, 5), (-1, -1.5, 5)]
    scene, reflectors = world([lump, sheet(aside, "metal")])
    paths = paths_of(scene, reflectors)
    real, _ = in_radar(scene, (5.0, 1.0, 1.15))
    image, _ = in_radar(scene, (5.0, -4.0, 1.15))

    def at(column, place):
        return np.linalg.norm(column - place, axis=-1) < 0.4

    both = at(paths.xyz, image) & at(paths.departure, image)
    one_way = at(paths.xyz, image) & at(paths.departure, real)
    other = at(paths.xyz, real) & at(paths.departure, image)
    direct = at(paths.xyz, real) & at(paths.departure, real)
    assert both.sum() > 5 and one_way.sum() == other.sum() >= both.sum()
    twice, once, never = (paths.power[m].sum() for m in (both, one_way, direct))
    assert twice < once < never
    without, no_mirror = world([lump])
    assert not at(paths_of(without, no_mirror).xyz, image).any()
    xyz, _ = cloud_of(paths)
    assert (np.linalg.norm(xyz[:, :2] - image[:2], axis=-1) < 0.5).any()


@pytest.mark.parametrize(("material", "seen"), [("drywall", True), ("metal", False)])
def test_thin_walls_let_something_through_and_metal_nothing(material, seen):
    lump = person((6.0, 0.0, 1.1), 0.2)
    scene, reflectors = world([lump, wall(3, material)])
    paths, (place, _) = paths_of(scene, reflectors), in_radar(scene, (6.0, 0.0, 1.2))
    behind = np.linalg.norm(paths.xyz - place, axis=-1) < 0.4
    assert behind.any() == seen
    if seen:
        alone = paths_of(*world([lump])).power.sum()  # of another speckle
        slab_of = MATERIALS[MATERIAL_IDS[material]]
        _, one_way = slab_shares(slab_of, np.array([1.0]), 78e9)
        ratio = paths.power[behind].sum() / alone
        assert ratio == pytest.approx(one_way[0] ** 2, rel=0.4)


def test_velocity_is_the_rate_of_the_distance():
    lump = person((0, 0, 0))
    far = moved(box((0.1, 0.1, 0.1), "rock"), (0, 30, 0))
    mover = straight(2.0, height=1.2)._replace(start_m=straight().start_m + 5.0)
    scene, reflectors = world([far], movers=[(lump, mover)], speed_mps=0.7)
    paths = paths_of(scene, reflectors)

    def distance(time_s):
        target, _ = pose_at(mover, np.array(time_s))
        radar, _ = sensor_pose(scene.platform, "single_chip", np.array(time_s))
        return np.linalg.norm(target - radar)

    rate = (distance(0.01) - distance(-0.01)) / 0.02
    assert rate == pytest.approx(1.3, abs=0.02)
    np.testing.assert_allclose(paths.velocity, rate, atol=0.05)


def test_platform_velocity_is_the_slope_of_its_positions():
    trajectory = make_scene("lab", 3).platform
    time_s = np.linspace(0, 20, 200)
    ahead, _ = pose_at(trajectory, time_s + 1e-3)
    behind, _ = pose_at(trajectory, time_s - 1e-3)
    velocity, spin = velocity_at(trajectory, time_s)
    np.testing.assert_allclose(velocity, (ahead - behind) / 2e-3, atol=1e-3)
    speed = np.linalg.norm(velocity, axis=-1)
    assert 0.3 < speed.mean() < 1.6 and speed.max() < 2.5
    assert 0.01 < np.abs(spin).mean() < 1.0


def test_a_room_has_twelve_edges_and_eight_corners():
    room = make_body(np.random.default_rng(0), box((4, 6, 3), "concrete"))
    found = find_reflectors((room,))
    assert len(found.facets[0].centre) == 6
    assert len(found.edges.start) == 12
    lengths = sorted(found.edges.length_m)
    np.testing.assert_allclose(lengths, [3] * 4 + [4] * 4 + [6] * 4, atol=0.1)
    inside = found.corners.xyz + 0.1 * found.corners.inward.sum(1)
    assert len(inside) == 8
    assert (np.abs(inside) < [2, 3, 3]).all() and (inside[:, 2] > 0).all()
    # A cube on the floor makes edges with it outside.
    solids = [slab((-5, -5), (5, 5), 0.0, "floor"), box((1, 1, 1), "metal")]
    edges = find_reflectors((make_body(np.random.default_rng(0), join(solids)),)).edges
    at_floor = np.abs(edges.inward[:, 0, 2]) == 1
    middle = edges.start + edges.along * edges.length_m[:, None] / 2
    outside = (middle * edges.inward[:, 1])[at_floor].sum(-1) > 0
    assert outside.sum() == 4


def test_noise_has_the_level_of_the_radar_equation():
    empty = paths_of(*world([moved(box((0.2, 0.2, 0.2), "rock"), (0, 40, 0))]))
    assert not empty.power.size
    frame = samples_of(empty, key=1).astype(float)
    noise_dbm = -173.975 + 10 * np.log10(10.666e6) + LINK.noise_figure_db
    full_scale_db = noise_dbm - LINK.full_scale_dbm
    expected = 32768**2 * 10 ** (full_scale_db / 10)
    assert (frame**2).sum(-1).mean() == pytest.approx(expected, rel=0.01)


def test_the_cascades_calibration_file_undoes_its_channels():
    radar = RadarSpec.cascade()
    hardware = make_hardware("cascade", radar)
    time = np.arange(256) / 256
    channels = np.exp(2j * np.pi * hardware.frequency[..., None] * time)
    channels *= hardware.phase[..., None]
    cube = np.broadcast_to(channels[:, :, None], radar.cube_shape).astype(np.complex64)
    bins = np.asarray(hardware.frequency)
    unit = Radar(radar, channels=1 / hardware.phase, beat_bins=bins)
    np.testing.assert_allclose(calibrate(cube, unit), 1, atol=1e-4)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_gives_a_radar_something_to_see(family):
    scene = make_scene(family, 11)
    paths = paths_of(scene, find_reflectors(scene.bodies), 1.0)
    assert 50 < len(paths.power) <= 1024
    assert (np.linalg.norm(paths.xyz + paths.departure, axis=-1) / 2 < 16).all()
    assert np.isfinite(paths.velocity).all() and np.abs(paths.velocity).max() < 8
    one, other = (s.bodies[0].solid.vertices for s in (scene, make_scene(family, 12)))
    assert one.shape != other.shape or np.abs(one - other).max() > 0.1
