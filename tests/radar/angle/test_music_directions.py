"""Directions by MUSIC: exact for one target, nearer to the truth for two."""

import jax.numpy as jnp
import numpy as np

from jradar.radar import RadarSpec, directions, music_directions

CHIP = RadarSpec.awr1843()


def plane_wave(azimuth, elevation, phase=0.0):
    """Values across the virtual array, a far target's; angles in radians."""
    u, w = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    columns, rows = CHIP.virtual_positions.T
    turn = 2 * np.pi * CHIP.spacing_wavelengths * (columns * u + rows * w)
    return np.exp(1j * (turn + phase))


def test_one_target_is_found_where_it_is():
    azimuth, elevation = np.radians([[-50, -20, 0, 8, 35], [3, -12, 0, 15, -8]])
    cells = np.stack([plane_wave(*angles) for angles in np.c_[azimuth, elevation]])
    found = music_directions(jnp.asarray(cells, jnp.complex64), CHIP)
    np.testing.assert_allclose(found[0], azimuth, atol=np.radians(0.3))
    np.testing.assert_allclose(found[1], elevation, atol=np.radians(0.5))
    batch = music_directions(jnp.asarray(cells.reshape(5, 1, 12), jnp.complex64), CHIP)
    np.testing.assert_allclose(batch[0][:, 0], found[0], atol=1e-5)


def test_of_two_targets_in_a_beam_one_is_found_that_the_spectrum_merges():
    true = np.radians([-5.0, 5.0])
    cell = plane_wave(true[0], 0.0) + 0.9 * plane_wave(true[1], 0.0, phase=0.4)
    cell = jnp.asarray(cell, jnp.complex64)
    merged, _ = directions(cell, CHIP)
    found, _ = music_directions(cell, CHIP)
    assert np.abs(true - merged).min() > np.radians(3)
    assert np.abs(true - found).min() < np.radians(1)
