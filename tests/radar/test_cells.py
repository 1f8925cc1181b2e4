"""Cells: one pass serves every detector; coupling and range bias; batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    RadarSpec,
    Scatterers,
    all_cells,
    ca_cfar,
    cell_points,
    go_cfar,
    os_cfar,
    power_map,
    radar_points,
    range_doppler,
    simulate_cube,
    so_cfar,
)

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
SCATTERERS = Scatterers(
    xyz=jnp.array([[3.0, 1.0, 0.3], [5.0, -2.0, -0.4], [6.5, 0.5, 0.0]]),
    velocity=jnp.array([0.5, -1.0, 0.0]),
    amplitude=jnp.array([50.0, 100.0, 80.0]),
)


CA = {"detector": "ca"}  # compiles fastest


def simulate(seed=0, radar=RADAR):
    return simulate_cube(jax.random.key(seed), SCATTERERS, radar, noise_power=1.0)


def close(actual, expected):
    for one, other in zip(actual, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("name", ["ca", "go", "so", "os"])
def test_points_of_a_mask_are_those_of_the_detector(name):
    """Of one row, of two and, for one detector, of the cascade's four."""
    detector = {"ca": ca_cfar, "go": go_cfar, "so": so_cfar, "os": os_cfar}[name]
    radars = {"ca": RadarSpec.cascade(), "go": RadarSpec.awr1642(num_chirps=32)}
    radar = radars.get(name, RADAR)
    options = {"guard": (1, 2), "train": (2, 5)}
    angles = {"num_azimuth": 128, "flip_azimuth": True}
    cube = simulate(radar=radar)
    cells = all_cells(cube, radar, **angles)
    mask = detector(
        cells.power, false_alarm_rate=0.05, channels=radar.num_virtual, **options
    )
    actual = cell_points(cells, mask, radar, capacity=200, **options)
    expected = radar_points(
        cube, radar, detector=name, false_alarm_rate=0.05, capacity=200,
        **options, **angles,
    )  # fmt: skip
    assert 10 < expected.valid.sum()
    np.testing.assert_array_equal(actual.valid, expected.valid)
    close(actual, expected)


def test_cells_without_refinement_and_without_static_echoes():
    cube, options = simulate(), {"refine": False, "capacity": 100}
    cells = all_cells(cube, RADAR, refine=False, remove_static=True)
    np.testing.assert_allclose(
        cells.power, power_map(cube, remove_static=True), rtol=1e-5
    )
    mask = ca_cfar(cells.power, false_alarm_rate=1e-3, channels=RADAR.num_virtual)
    expected = radar_points(cube, RADAR, **CA, remove_static=True, **options)
    assert expected.valid.any()
    close(cell_points(cells, mask, RADAR, **options), expected)


def test_vmap_equals_the_loop():
    cubes = jnp.stack([simulate(seed) for seed in range(3)])

    def points(cube):
        cells = all_cells(cube, RADAR)
        return cell_points(cells, cells.power > 100, RADAR, capacity=16)

    many = jax.vmap(points)(cubes)
    for i, cube in enumerate(cubes):
        close(jax.tree.map(lambda column, i=i: column[i], many), points(cube))


def leakage():
    """Coupling of the antennas in a cube, and in the form of ColoRadar's file."""
    rng = np.random.default_rng(0)
    phases = np.exp(2j * np.pi * rng.random((3, 4, 1)))
    x = 2 * np.pi * np.arange(64) / 64
    samples = 3000 * phases * np.exp(1.4j * x)
    blackman = 0.42 - 0.5 * np.cos(x) + 0.08 * np.cos(2 * x)
    coupling = np.fft.fft(samples * blackman)[..., 1:33]
    return jnp.array(samples[:, :, None], "complex64"), jnp.array(coupling, "complex64")


def test_coupling_is_no_detection_once_it_is_subtracted():
    samples, coupling = leakage()
    cube = simulate() + samples
    near = 3 * RADAR.range_resolution_m

    def distances(**options):
        cloud = radar_points(cube, RADAR, **CA, false_alarm_rate=1e-6, **options)
        xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
        return np.linalg.norm(xyz, axis=-1)

    raw, calibrated = distances(), distances(coupling=coupling)
    assert raw[0] < near and calibrated.min() > near  # the strongest of all was leakage
    for xyz in SCATTERERS.xyz:
        gap = np.abs(calibrated - np.linalg.norm(xyz)).min()
        assert gap < RADAR.range_resolution_m / 2


def test_cells_have_their_coupling_subtracted_as_points_have():
    samples, coupling = leakage()
    cube = simulate() + samples
    for remove_static in (False, True):
        options = {"coupling": coupling, "remove_static": remove_static}
        cells = all_cells(cube, RADAR, **options)
        mask = ca_cfar(cells.power, false_alarm_rate=1e-3, channels=RADAR.num_virtual)
        expected = radar_points(cube, RADAR, **CA, **options)
        close(cell_points(cells, mask, RADAR), expected)


def test_static_removal_leaves_no_coupling_to_subtract():
    samples, coupling = leakage()
    cube = simulate() + samples
    cells = all_cells(cube, RADAR, coupling=coupling, remove_static=True)
    _, without = range_doppler(simulate(), remove_static=True)
    np.testing.assert_allclose(cells.power, without, rtol=1e-2, atol=1e-3)


def test_range_bias_shortens_ranges_and_nothing_else():
    cube, bias = simulate(), 1.3 * RADAR.range_resolution_m
    cells, options = all_cells(cube, RADAR), {"capacity": 3000, "range_bias_m": bias}
    plain = cell_points(cells, cells.power > 0, RADAR, capacity=3000)
    biased = cell_points(cells, cells.power > 0, RADAR, **options)
    assert plain.valid.sum() == 32 * 61 and biased.valid.sum() == 32 * 60
    kept = np.isin(plain.power, biased.power) & np.asarray(plain.valid)
    longer, shorter = np.asarray(plain.xyz)[kept], np.asarray(biased.xyz)[: kept.sum()]
    distance = np.linalg.norm(longer, axis=-1, keepdims=True)
    np.testing.assert_allclose(shorter, longer * (1 - bias / distance), atol=1e-4)
    assert np.linalg.norm(shorter, axis=-1).min() > 0
    close(radar_points(cube, RADAR, **CA, false_alarm_rate=1.0, **options), biased)


def test_cube_of_another_radar_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 4, 8, 16\), awr1843 needs"):
        all_cells(jnp.zeros((2, 4, 8, 16), complex), RADAR)
