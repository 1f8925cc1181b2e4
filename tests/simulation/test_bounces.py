"""Bounces and wind: the two-ray law, Friis between walls, Billingsley's spectrum."""

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.simulation.paths.bounces import (
    echoes_between_walls,
    floor_paths,
    floor_share,
    is_floor,
)
from jradar.simulation.paths.clutter import beta, foliage_velocity, standing_ratio
from jradar.simulation.paths.line_of_sight import Paths, Sight, surface_tables
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.propagation import radar_paths
from jradar.simulation.rig import Viewpoint
from jradar.simulation.scenes.scene import placements
from jradar.simulation.scenes.solids import box, moved, sheet, slab
from jradar.simulation.units import UnitSpec
from tests.simulation.worlds import wall, world

RADAR = RadarSpec.awr1843()
HEIGHT, AWAY = 1.2, 9.0
FLOOR = slab((-20, -20), (20, 20), 0.0, "metal")


def sight_of(scene, speed=0.0):
    """The radar `HEIGHT` above the floor, moving ahead."""
    place, velocity = np.array([0, 0, HEIGHT]), np.array([speed, 0, 0])
    view = Viewpoint(place, np.eye(3), velocity)
    return Sight(scene, placements(scene, 0.0), view, RADAR)


def bounces(solids, heights):
    """Paths to targets of equal power, `AWAY` ahead of the radar, and their bounces."""
    scene, _ = world(solids)
    xyz = np.column_stack([np.full_like(heights, AWAY), 0 * heights, heights])
    there, none = xyz - [0, 0, HEIGHT], np.zeros(len(heights))
    scattered = Paths(there, there, none, none + 1)
    found = floor_paths(sight_of(scene), scattered, (xyz, 0 * xyz), roughness_m=0.0)
    return scattered, found


def between_walls(solids, speed=0.0):
    scene, reflectors = world(solids)
    return echoes_between_walls(sight_of(scene, speed), reflectors.facets[0])


def phasors(paths):
    legs = np.linalg.norm(paths.xyz, axis=-1) + np.linalg.norm(paths.departure, axis=-1)
    return np.sqrt(paths.power) * np.exp(2j * np.pi * legs / RADAR.wavelength_m)


def test_floor_bounces_follow_the_two_ray_law():
    heights = np.linspace(0.3, 1.6, 131)
    scattered, found = bounces([FLOOR], heights)
    assert len(found.power) == 3 * len(heights)
    total = phasors(scattered) + phasors(found).reshape(3, -1).sum(0)

    direct = np.hypot(AWAY, HEIGHT - heights)
    bounced = np.hypot(AWAY, HEIGHT + heights)
    fall = (direct / bounced) ** (1 + LINK.elevation_power / 2)  # spreading, antennas
    turn = np.exp(2j * np.pi * (bounced - direct) / RADAR.wavelength_m)
    law = np.abs(1 - fall * turn) ** 4
    assert law.min() < 0.05 and law.max() > 5
    np.testing.assert_allclose(np.abs(total) ** 2, law, atol=0.05, rtol=0.02)


def test_roughness_takes_from_the_bounce_as_ament_says():
    wavelength, cosine = RADAR.wavelength_m, np.array([0.1, 0.5])
    rough = wavelength / (4 * np.pi * cosine)
    sizes = {"roughness_m": rough, "wavelength_m": wavelength}
    share = floor_share(cosine, np.full(2, 0.5), **sizes)
    np.testing.assert_allclose(share, 0.5 / np.e)


def test_no_bounce_where_the_floor_is_hidden():
    hidden = moved(box((0.5, 6.0, 0.8), "metal"), (AWAY / 2, 0, 0))
    _, found = bounces([FLOOR, hidden], np.array([1.1]))
    assert not found.power.size


def test_a_unit_with_floor_bounces_has_them_instead_of_ghosts_in_the_floor():
    target = moved(box((0.2, 0.2, 1.4), "metal"), (4.0, 0.0, 0.0))
    scene, reflectors = world([FLOOR, target])
    assert is_floor(reflectors.facets[0])[0]  # and the underside of the box

    def below(**changes):
        unit = UnitSpec(**changes)
        paths = radar_paths(scene, reflectors, "single_chip", 0.0, RADAR, unit=unit)
        return np.count_nonzero(paths.xyz[:, 2] < -1.4)

    assert below() and below(floor_bounces=True, floor_roughness_m=0.0)
    assert not below(floor_bounces=True, floor_roughness_m=0.1)


def upright(x):
    return wall(x, "metal", (-6, 6), (0, 4))


def test_echoes_between_parallel_walls_have_the_power_of_friis():
    a, b, speed = 3.0, 2.0, 0.7
    paths = between_walls([upright(a), upright(-b)], speed)
    length = np.linalg.norm(paths.xyz, axis=-1)
    np.testing.assert_allclose(np.sort(length), [a + b, a + b, a + 2 * b, 2 * a + b])
    best = int(np.argmax(paths.power))  # twice the wall ahead, once that behind
    np.testing.assert_allclose(paths.xyz[best], [2 * a + b, 0, 0], atol=1e-6)
    assert paths.velocity[best] == pytest.approx(-speed)
    sent_dbm = LINK.transmit_dbm + 2 * LINK.gain_dbi - LINK.losses_db
    way = 4 * np.pi * 2 * (2 * a + b)
    friis = 10 ** (sent_dbm / 10) * (RADAR.wavelength_m / way) ** 2
    metal = surface_tables(RADAR.center_frequency_hz).mirrored[3, -1]
    assert paths.power[best] == pytest.approx(friis * metal**3, rel=1e-3)
    through = paths.velocity[np.isclose(length, a + b)]  # one wall nears, one recedes
    np.testing.assert_allclose(through, 0, atol=1e-9)
    aside = sheet([(-6, 3, 0), (6, 3, 0), (6, 3, 4), (-6, 3, 4)], "metal")
    assert not between_walls([upright(3.0), aside]).power.size


def test_leaves_have_billingsleys_spectrum():
    wind, count = 10.0, 40_000
    draw = foliage_velocity(wind, RADAR, 1.0)
    assert draw is not None
    velocity = draw(count)
    ratio = standing_ratio(wind, RADAR.center_frequency_hz)
    assert np.mean(velocity == 0) == pytest.approx(ratio / (1 + ratio), rel=0.1)
    moving = np.abs(velocity[velocity != 0])
    for speed in (0.05, 0.2, 0.5):
        share = np.mean(moving > speed)
        assert share == pytest.approx(np.exp(-beta(wind) * speed), rel=0.1)
    assert [beta(wind) for wind in (3.0, 10.0, 20.0, 40.0)] == [12.0, 8.0, 5.7, 4.3]
    assert standing_ratio(10.0, 1e9) == pytest.approx(489.8 * 10**-1.55)
    assert foliage_velocity(0.0, RADAR, 1.0) is None


def test_the_wind_moves_leaves_and_no_walls():
    rock = wall(7, "rock", (-3, 3), (0.2, 3))
    scene, reflectors = world([wall(4, "foliage", (-3, 3), (0.2, 3)), rock])
    unit = UnitSpec(wind_mph=10.0)
    paths = radar_paths(scene, reflectors, "single_chip", 0.0, RADAR, unit=unit)
    near = paths.xyz[:, 0] < 5.5
    spread = paths.velocity[near].std()
    assert spread == pytest.approx(2**0.5 / beta(10.0), rel=0.35)
    far = ~near & (paths.xyz == paths.departure).all(-1) & (paths.xyz[:, 0] < 8)
    assert far.any() and np.abs(paths.velocity[far]).max() < 1e-6
