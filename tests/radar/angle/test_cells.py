"""Cells: one pass serves every detector; coupling and range bias; batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import Radar, all_cells, cell_points, detect, range_doppler
from tests.radar.targets import (
    CASCADE,
    CELLS,
    SMALL,
    STATIC,
    WIDE,
    close,
    cloud_of,
    simulate,
    spherical,
    targets,
)

PLACES = [(3.2, 18, 5, 0.5), (5.4, -22, -4, -1.0), (6.5, 4, 0, 0.0)]
SCATTERERS = targets(*PLACES)
CUBE = simulate(SCATTERERS)
UNIT = Radar(SMALL)


@pytest.fixture(scope="module")
def cells():
    return all_cells(CUBE, UNIT, points=CELLS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radar", "points"), [(SMALL, CELLS), (CASCADE, WIDE)], ids=["chip", "cascade"]
)
def test_points_of_the_detectors_mask_are_radar_points(radar, points):
    cube = simulate(SCATTERERS, radar)
    cells = all_cells(cube, Radar(radar), points=points)
    mask = detect(cells.power, radar, points=points)
    expected = cloud_of(cube, radar, points)
    assert 10 < expected.valid.sum()
    close(cell_points(cells, mask, Radar(radar), points=points), expected)


def leakage():
    """Coupling of the antennas in a cube, and in the form of ColoRadar's file."""
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random((3, 4, 1)))
    x = 2 * np.pi * np.arange(64) / 64
    samples = 3000 * phases * np.exp(1.4j * x)
    blackman = 0.42 - 0.5 * np.cos(x) + 0.08 * np.cos(2 * x)
    coupling = np.fft.fft(samples * blackman)[..., 1:33]
    return jnp.array(samples[:, :, None], "complex64"), jnp.array(coupling, "complex64")


def test_coupling_is_not_detected_once_it_is_subtracted():
    samples, coupling = leakage()
    cube, unit = CUBE + samples, Radar(SMALL, leakage=coupling)
    near = 3 * SMALL.range_resolution_m
    raw, clean = (cloud_of(cube, u) for u in (UNIT, unit))
    distances = spherical(clean.xyz[clean.valid])[0]
    assert spherical(raw.xyz[:1])[0] < near  # the leakage was the strongest
    assert distances.min() > near
    for distance, *_ in PLACES:
        assert np.abs(distances - distance).min() < SMALL.range_resolution_m / 2
    cells = all_cells(cube, unit, points=CELLS)
    mask = detect(cells.power, SMALL, points=CELLS.subtracting(coupling))
    close(cell_points(cells, mask, unit, points=CELLS), clean)


def test_static_removal_leaves_no_coupling_to_subtract():
    """On bins, because nothing is refined either."""
    samples, coupling = leakage()
    unit = Radar(SMALL, leakage=coupling)
    cells = all_cells(CUBE + samples, unit, points=STATIC)
    _, without = range_doppler(CUBE, remove_static=True)
    np.testing.assert_allclose(cells.power, without, rtol=1e-2, atol=1e-3)
    mask = detect(cells.power, SMALL, points=STATIC)
    expected = cloud_of(CUBE + samples, points=STATIC)
    assert expected.valid.any()
    close(cell_points(cells, mask, unit, points=STATIC), expected)


def test_range_bias_shortens_ranges_and_nothing_else(cells):
    bias = 1.7 * SMALL.range_resolution_m
    unit, every = Radar(SMALL, range_bias_m=bias), cells.power > 0
    units = Radar(SMALL, range_bias_m=0.0), unit
    plain, biased = (cell_points(cells, every, u, points=CELLS) for u in units)
    assert plain.valid.sum() == 32 * 61  # without bin 0 and the last two
    assert biased.valid.sum() == 32 * 59  # nor what would be nearer than 0
    kept = np.isin(plain.power, biased.power) & np.asarray(plain.valid)
    longer, shorter = np.asarray(plain.xyz)[kept], np.asarray(biased.xyz)[: kept.sum()]
    distance = np.linalg.norm(longer, axis=-1, keepdims=True)
    np.testing.assert_allclose(shorter, longer * (1 - bias / distance), atol=1e-4)
    assert np.linalg.norm(shorter, axis=-1).min() > 0
    mask = detect(cells.power, SMALL, points=CELLS)
    found = cell_points(cells, mask, unit, points=CELLS)
    close(found, cloud_of(CUBE, unit))


@pytest.mark.usefixtures("as_a_user")
def test_cells_of_another_radar_are_refused(cells):
    half = jax.tree.map(lambda column: column[:, :32], cells)
    mask = cells.power > 0
    with pytest.raises(ValueError, match=r"power has shape \(32, 32\), awr1843 needs"):
        cell_points(half, mask, UNIT, points=CELLS)
    with pytest.raises(ValueError, match=r"mask has shape \(32, 32\), awr1843 needs"):
        cell_points(cells, mask[:, :32], UNIT, points=CELLS)
