"""Targets faster than the unambiguous velocity: fold, direction, margin."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar.angle.folds import velocity_folds
from tests.radar.targets import (
    CASCADE,
    CELLS,
    FLAT,
    SMALL,
    cloud_of,
    degrees,
    noise,
    simulate,
    single,
    target,
    waves_towards,
)

FOLDED = dataclasses.replace(CELLS, folds=1)
SHORT_CASCADE = dataclasses.replace(CASCADE, num_samples=32)


@pytest.mark.parametrize("velocity", [2.6, -3.1, 6.0, 1.0])
def test_a_fast_target_has_its_velocity_and_direction(velocity):
    cube = simulate(target(4.0, 15, 3, velocity))
    cloud, folded = (cloud_of(cube, points=p) for p in (FOLDED, CELLS))
    fold = round(velocity / (2 * SMALL.max_velocity_mps))
    assert cloud.fold[0] == fold and cloud.fold_margin_db[0] > 0.5
    assert cloud.velocity[0] == pytest.approx(velocity, abs=0.02)
    np.testing.assert_allclose(degrees(cloud), [[15, 3]], atol=1)
    assert folded.fold is None and folded.fold_margin_db is None
    assert (abs(degrees(folded)[0, 0] - 15) > 5) == bool(fold)


def lead(radar):
    """Place of each virtual antenna in its turn, in turns."""
    return np.repeat(radar.firing_position, radar.num_rx) / radar.num_tx


def plane_waves(radar, count, snr_db):
    """Snapshots of folded plane waves in noise, their Doppler bins and folds."""
    rng = np.random.default_rng(0)
    u, w = rng.uniform(-0.8, 0.8, count), rng.uniform(-0.3, 0.3, count)
    wave = waves_towards(radar, u, w * radar.has_elevation)
    fold, half = rng.integers(-1, 2, count), radar.num_chirps / 2
    doppler = rng.uniform(-half, half, count)
    cycles = np.outer(doppler / radar.num_chirps + fold, lead(radar))
    grain = noise(*wave.shape) * np.sqrt(0.5 / 10 ** (snr_db / 10))
    wave = wave * np.exp(2j * np.pi * cycles) + grain
    return single(wave), jnp.asarray(doppler, jnp.float32), fold


@pytest.mark.parametrize(
    ("radar", "num_azimuth", "least_db"),
    [(SMALL, 64, 0.3), (SHORT_CASCADE, 128, 1.5)],
    ids=["chip", "cascade"],
)
def test_folds_are_right_for_every_direction(radar, num_azimuth, least_db):
    snapshot, doppler, fold = plane_waves(radar, 64, 15)
    found = velocity_folds(snapshot, doppler, radar, num_azimuth=num_azimuth)
    np.testing.assert_array_equal(found.fold, fold)
    assert found.margin_db.min() > least_db


def test_the_margin_is_that_of_the_beams_of_all_directions():
    """Searched on a grid, in float64, for the two folds that are wrong."""
    waves = waves_towards(SMALL, [0.3, -0.6, 0.1, 0.9], [0.1, -0.2, 0.3, 0.0])
    found = velocity_folds(single(np.tile(waves, (16, 1))), jnp.zeros(64), SMALL)
    grid = np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201))
    visible = np.hypot(*grid) <= 1
    beams = waves_towards(SMALL, *(sine[visible] for sine in grid)).conj()
    turns = (np.exp(2j * np.pi * fold * lead(SMALL)) for fold in (-1, 1))
    wrong = [abs((waves * turn) @ beams.T).max(1) ** 2 for turn in turns]
    assert not found.fold.any()
    expected = 10 * np.log10(12**2 / np.max(wrong, 0))
    np.testing.assert_allclose(found.margin_db[:4], expected, atol=0.1)
    assert expected.min() > 0.5


def test_folds_that_look_alike_give_the_lower_speed():
    # Two transmitters cannot tell fold 1 from fold -1.
    snapshot, doppler, fold = plane_waves(FLAT, 64, 20)
    found = np.asarray(velocity_folds(snapshot, doppler, FLAT).fold)
    np.testing.assert_array_equal(found % 2, fold % 2)
    turned = np.asarray(doppler) / FLAT.num_chirps
    np.testing.assert_array_less(abs(turned + found), 1.0 + 1e-6)
    assert (abs(turned + found) <= abs(turned - found) + 1e-6).all()


def test_one_transmitter_has_nothing_to_tell_folds_by():
    alone = dataclasses.replace(SMALL, tx_positions=((0, 0),), tx_firing_order=(0,))
    snapshot, doppler, _ = plane_waves(alone, 4, 20)
    found = velocity_folds(snapshot, doppler, alone)
    assert not found.fold.any() and (found.margin_db == 99).all()


def test_impossible_folds_are_refused():
    with pytest.raises(ValueError, match="most=-1, expected 0 or more folds"):
        velocity_folds(jnp.ones((1, 12), complex), jnp.zeros(1), SMALL, most=-1)
