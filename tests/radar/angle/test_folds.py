"""Targets faster than the unambiguous velocity: fold, direction, margin."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    all_cells,
    cell_points,
    detect,
    radar_points,
    velocity_folds,
)
from tests.radar.targets import CASCADE, FLAT, SMALL, simulate, spherical, target

ONE = PointSpec(detector="ca", capacity=4)
FOLDED = dataclasses.replace(ONE, folds=1)
TINY = dataclasses.replace(SMALL, num_chirps=8, num_samples=32)
SHORT_CASCADE = dataclasses.replace(CASCADE, num_samples=32)


@pytest.mark.parametrize("velocity", [2.6, -3.1, 6.0, 1.0])
def test_a_fast_target_has_its_velocity_and_direction(velocity):
    cube = simulate(target(4.0, 15, 3, velocity))
    cloud = radar_points(cube, SMALL, points=FOLDED)
    fold = round(velocity / (2 * SMALL.max_velocity_mps))
    assert cloud.fold[0] == fold and cloud.fold_margin_db[0] > 0.5
    assert cloud.velocity[0] == pytest.approx(velocity, abs=0.02)
    _, azimuth, elevation = spherical(cloud.xyz[:1])
    np.testing.assert_allclose(np.degrees([azimuth[0], elevation[0]]), [15, 3], atol=1)
    folded = radar_points(cube, SMALL, points=ONE)
    assert folded.fold is None and folded.fold_margin_db is None
    wrong = abs(np.degrees(spherical(folded.xyz[:1])[1][0]) - 15) > 5
    assert wrong == bool(fold)


@pytest.mark.parametrize(
    ("radar", "changes"),
    [(SMALL, {}), (TINY, {"focus": True, "train": (1, 2), "guard": (1, 2)})],
    ids=["alone", "with focus"],
)
def test_cells_have_the_folds_of_points(radar, changes):
    velocity = 1.3 * radar.max_velocity_mps
    cube = simulate(target(9 * radar.range_resolution_m, 15, 3, velocity), radar)
    points = dataclasses.replace(FOLDED, **changes)
    cells = all_cells(cube, radar, points=points)
    mask = detect(cells.power, radar, points=points)
    found = cell_points(cells, mask, radar, points=points)
    expected = radar_points(cube, radar, points=points)
    assert found.fold[0] == 1
    assert found.velocity[0] == pytest.approx(velocity, abs=0.03)
    for one, other in zip(found, expected, strict=True):
        if other is not None:
            np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-3)


def plane_waves(radar, count, snr_db):
    """Snapshots of folded plane waves in noise, their Doppler bins and folds."""
    rng = np.random.default_rng(0)
    u, w = rng.uniform(-0.8, 0.8, count), rng.uniform(-0.3, 0.3, count)
    fold, half = rng.integers(-1, 2, count), radar.num_chirps / 2
    doppler = rng.uniform(-half, half, count)
    columns, rows = radar.virtual_positions.T
    cycles = np.outer(u, columns * radar.spacing_wavelengths)
    cycles += np.outer(w * radar.has_elevation, rows * radar.row_spacing_wavelengths)
    lead = np.repeat(radar.firing_position, radar.num_rx) / radar.num_tx
    cycles += np.outer(doppler / radar.num_chirps + fold, lead)
    noise = rng.normal(size=(2, *cycles.shape)) * np.sqrt(0.5 / 10 ** (snr_db / 10))
    wave = np.exp(2j * np.pi * cycles) + noise[0] + 1j * noise[1]
    return jnp.asarray(wave, jnp.complex64), jnp.asarray(doppler, jnp.float32), fold


@pytest.mark.parametrize(
    ("radar", "num_azimuth", "least_db"),
    [(SMALL, 64, 0.3), (SHORT_CASCADE, 128, 1.5)],
    ids=["awr1843", "cascade"],
)
def test_folds_are_right_for_every_direction(radar, num_azimuth, least_db):
    snapshot, doppler, fold = plane_waves(radar, 64, 15)
    found = velocity_folds(snapshot, doppler, radar, num_azimuth=num_azimuth)
    np.testing.assert_array_equal(found.fold, fold)
    assert found.margin_db.min() > least_db


def test_the_margin_is_the_power_of_the_beam_over_that_of_the_next_best_fold():
    """Of a search over all directions, which may find a little more of a wrong fold."""
    snapshot, doppler, _ = plane_waves(SMALL, 12, 15)
    found = velocity_folds(snapshot, doppler, SMALL)
    columns, rows = SMALL.virtual_positions.T
    u, w = np.meshgrid(np.linspace(-1, 1, 401), np.linspace(-1, 1, 201))
    cycles = np.multiply.outer(u, columns * SMALL.spacing_wavelengths)
    cycles += np.multiply.outer(w, rows * SMALL.row_spacing_wavelengths)
    beams = np.exp(-2j * np.pi * cycles)
    lead = np.repeat(SMALL.firing_position, SMALL.num_rx) / SMALL.num_tx
    turns = np.asarray(doppler)[:, None] / SMALL.num_chirps + np.array([-1, 0, 1])
    waves = snapshot[:, None] * np.exp(-2j * np.pi * turns[..., None] * lead)
    power = np.abs(np.einsum("abv,cfv->cfab", beams, waves)) ** 2
    falling = np.sort(power.max((2, 3)), 1)[:, ::-1]
    more = found.margin_db - 10 * np.log10(falling[:, 0] / falling[:, 1])
    assert more.min() > -0.01 and np.median(more) < 0.1 and more.max() < 0.4


def test_folds_that_look_alike_give_the_lower_speed():
    # Two transmitters cannot tell fold 1 from fold -1.
    snapshot, doppler, fold = plane_waves(FLAT, 64, 20)
    found = velocity_folds(snapshot, doppler, FLAT)
    np.testing.assert_array_equal(found.fold % 2, fold % 2)
    turned = np.asarray(doppler) / FLAT.num_chirps
    np.testing.assert_array_less(abs(turned + found.fold), 1.0 + 1e-6)
    assert (abs(turned + found.fold) <= abs(turned - found.fold) + 1e-6).all()


def test_one_transmitter_has_nothing_to_tell_folds_by():
    alone = dataclasses.replace(SMALL, tx_positions=((0, 0),), tx_firing_order=(0,))
    snapshot, doppler, _ = plane_waves(alone, 4, 20)
    found = velocity_folds(snapshot, doppler, alone)
    assert not found.fold.any() and (found.margin_db == 99).all()


def test_impossible_folds_are_refused():
    with pytest.raises(ValueError, match="folds = -1, expected 0 to 16"):
        PointSpec(folds=-1)
    with pytest.raises(ValueError, match="most=-1, expected 0 or more folds"):
        velocity_folds(jnp.ones((1, 12), complex), jnp.zeros(1), SMALL, most=-1)
