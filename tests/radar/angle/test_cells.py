"""Cells: one pass serves every detector; coupling and range bias; batches."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    Radar,
    Scatterers,
    all_cells,
    cell_points,
    compensate_tdm,
    detect,
    power_map,
    radar_points,
    range_doppler,
)
from tests.radar.targets import ALL, CASCADE, CELLS, FLAT, SMALL, STATIC, WIDE, simulate

SCATTERERS = Scatterers(
    xyz=jnp.array([[3.0, 1.0, 0.3], [5.0, -2.0, -0.4], [6.5, 0.5, 0.0]]),
    velocity=jnp.array([0.5, -1.0, 0.0]),
    amplitude=jnp.array([50.0, 100.0, 80.0]),
)
CUBE = simulate(SCATTERERS)
FINE = {"num_azimuth": 128, "false_alarm_rate": 0.05}


def close(actual, expected):
    np.testing.assert_array_equal(actual.valid, expected.valid)
    pairs = zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("radar", "points"),
    [
        (FLAT, dataclasses.replace(CELLS, detector="go", **FINE)),
        (SMALL, dataclasses.replace(WIDE, capacity=200, **FINE)),
        (CASCADE, WIDE),
    ],
    ids=["one row, GO", "two rows, OS", "four rows, OS"],
)
def test_points_of_the_detectors_mask_are_radar_points(radar, points):
    cube = simulate(SCATTERERS, radar)
    cells = all_cells(cube, Radar(radar), points=points)
    mask = detect(cells.power, radar, points=points)
    expected = radar_points(cube, Radar(radar), points=points)
    assert 10 < expected.valid.sum()
    close(cell_points(cells, mask, Radar(radar), points=points), expected)


def test_cells_without_refinement_and_without_static_echoes():
    cells = all_cells(CUBE, Radar(SMALL), points=STATIC)
    np.testing.assert_allclose(
        cells.power, power_map(CUBE, remove_static=True), rtol=1e-5
    )
    mask = detect(cells.power, SMALL, points=STATIC)
    expected = radar_points(CUBE, Radar(SMALL), points=STATIC)
    assert expected.valid.any()
    close(cell_points(cells, mask, Radar(SMALL), points=STATIC), expected)


def test_vmap_equals_the_loop():
    cubes = [simulate(SCATTERERS, seed=seed) for seed in range(3)]

    def points(cube):
        cells = all_cells(cube, Radar(SMALL), points=CELLS)
        return cell_points(cells, cells.power > 100, Radar(SMALL), points=CELLS)

    many = jax.vmap(points)(jnp.stack(cubes))
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


def test_coupling_is_not_detected_once_it_is_subtracted():
    samples, coupling = leakage()
    near = 3 * SMALL.range_resolution_m

    def distances(**measured):
        cloud = radar_points(CUBE + samples, Radar(SMALL, **measured), points=CELLS)
        xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
        return np.linalg.norm(xyz, axis=-1)

    raw, calibrated = distances(), distances(leakage=coupling)
    assert raw[0] < near and calibrated.min() > near  # the leakage was the strongest
    for xyz in SCATTERERS.xyz:
        gap = np.abs(calibrated - np.linalg.norm(xyz)).min()
        assert gap < SMALL.range_resolution_m / 2


def test_coupling_is_subtracted_from_cells_as_from_points():
    samples, coupling = leakage()
    radar = Radar(SMALL, leakage=coupling)
    cells = all_cells(CUBE + samples, radar, points=CELLS)
    blackman = CELLS.subtracting(coupling)
    mask = detect(cells.power, SMALL, points=blackman)
    expected = radar_points(CUBE + samples, radar, points=CELLS)
    close(cell_points(cells, mask, radar, points=CELLS), expected)


def test_static_removal_leaves_no_coupling_to_subtract():
    samples, coupling = leakage()
    cells = all_cells(CUBE + samples, Radar(SMALL, leakage=coupling), points=STATIC)
    _, without = range_doppler(CUBE, remove_static=True)
    np.testing.assert_allclose(cells.power, without, rtol=1e-2, atol=1e-3)


def test_range_bias_shortens_ranges_and_nothing_else():
    bias = 1.3 * SMALL.range_resolution_m
    cells = all_cells(CUBE, Radar(SMALL), points=CELLS)
    plain = cell_points(cells, cells.power > 0, Radar(SMALL), points=CELLS)
    biased = cell_points(
        cells, cells.power > 0, Radar(SMALL, range_bias_m=bias), points=CELLS
    )
    assert plain.valid.sum() == 32 * 61 and biased.valid.sum() == 32 * 60
    kept = np.isin(plain.power, biased.power) & np.asarray(plain.valid)
    longer, shorter = np.asarray(plain.xyz)[kept], np.asarray(biased.xyz)[: kept.sum()]
    distance = np.linalg.norm(longer, axis=-1, keepdims=True)
    np.testing.assert_allclose(shorter, longer * (1 - bias / distance), atol=1e-4)
    assert np.linalg.norm(shorter, axis=-1).min() > 0
    close(radar_points(CUBE, Radar(SMALL, range_bias_m=bias), points=ALL), biased)


@pytest.mark.usefixtures("as_a_user")
def test_cells_of_another_radar_are_refused():
    cells = all_cells(CUBE, Radar(SMALL), points=CELLS)
    half = jax.tree.map(lambda column: column[:, :32], cells)
    mask = cells.power > 0
    with pytest.raises(ValueError, match=r"power has shape \(32, 32\), awr1843 needs"):
        cell_points(half, mask, Radar(SMALL), points=CELLS)
    with pytest.raises(ValueError, match=r"mask has shape \(32, 32\), awr1843 needs"):
        cell_points(cells, mask[:, :32], Radar(SMALL), points=CELLS)


@pytest.mark.usefixtures("as_a_user")
def test_spectrum_of_another_radar_is_refused():
    with pytest.raises(
        ValueError, match="24 values per snapshot, awr1843 has 3 tx x 4"
    ):
        compensate_tdm(jnp.ones((5, 24), complex), jnp.zeros(5), SMALL)


def test_cube_of_another_radar_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 4, 8, 16\), awr1843 needs"):
        all_cells(jnp.zeros((2, 4, 8, 16), complex), Radar(SMALL))
