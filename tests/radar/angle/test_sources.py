"""Capon and MUSIC as directions; the number of sources by MDL."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import directions
from jradar.radar.angle import subspace
from jradar.radar.angle.sources import mdl_sources
from jradar.radar.angle.subspace import source_count, subspace_directions
from tests.radar.targets import CASCADE, SMALL, noise, plane_wave, single, waves_towards

CAPON, MUSIC = (
    functools.partial(subspace_directions, method=name) for name in ("capon", "music")
)
FINDERS = {
    "capon": functools.partial(subspace_directions, method="capon"),
    "music": functools.partial(subspace_directions, method="music"),
    "music, counted": functools.partial(
        subspace_directions, method="music", num_sources=None
    ),
}


def snapshots(radar, azimuth_sines, count, snr_db=20.0):
    """Snapshots [cell, virtual] of sources with random phases."""
    rng = np.random.default_rng(0)
    grain = noise(count, radar.num_virtual, seed=1)
    wave = np.sqrt(0.5 / 10 ** (snr_db / 10)) * grain
    for u in azimuth_sines:
        phase = 2 * np.pi * rng.uniform(size=(count, 1))
        wave = wave + waves_towards(radar, u, 0.0, phase)
    return single(wave)


def test_mdl_is_its_formula():
    """For eigenvalues of every number of sources, clear and less clear ones."""
    rng = np.random.default_rng(0)
    values = rng.uniform(0.7, 1.4, (60, 6))
    for i, sources in enumerate(rng.integers(0, 5, 60)):
        values[i, :sources] *= rng.uniform(1.5, 8)
    expected = []
    for one in values:
        falling, lengths = np.sort(one)[::-1], []
        for k in range(6):
            rest = falling[k:]
            ratio = np.log(rest.mean()) - np.log(rest).mean()
            lengths.append(30 * len(rest) * ratio + k * (12 - k) / 2 * np.log(30))
        expected.append(np.argmin(lengths))
    np.testing.assert_array_equal(
        mdl_sources(jnp.asarray(values), samples=30), expected
    )
    assert len(set(expected)) > 3


@pytest.mark.parametrize(
    ("radar", "azimuth_sines", "share"),
    [
        (SMALL, [], 0.7),
        (SMALL, [0.1], 0.7),
        (SMALL, [-0.2, 0.3], 0.7),
        (CASCADE, [0.1], 0.85),
        (CASCADE, [0.0, 0.02], 0.85),
    ],
)
def test_sources_of_single_snapshots_are_counted(radar, azimuth_sines, share):
    cells = snapshots(radar, azimuth_sines, 60)
    found = source_count(cells[:, None], radar)
    assert (np.asarray(found) == len(azimuth_sines)).mean() > share


@pytest.mark.parametrize("find", FINDERS.values(), ids=FINDERS)
def test_one_target_is_found_where_it_is_whatever_the_block(find, monkeypatch):
    monkeypatch.setattr(subspace, "BLOCK", 2)  # of five cells, which no other test has
    angles = np.radians([[-50, -20, 0, 8, 35], [3, -12, 0, 15, -8]])
    cells = single(plane_wave(SMALL, *angles))
    found = find(cells, SMALL)
    np.testing.assert_allclose(found[0], angles[0], atol=np.radians(0.3))
    np.testing.assert_allclose(found[1], angles[1], atol=np.radians(0.5))
    batch = find(cells[:, None], SMALL)
    np.testing.assert_allclose(batch[0][:, 0], found[0], atol=1e-5)


def test_of_two_targets_in_a_beam_one_is_found_that_the_spectrum_merges():
    true = np.array([-0.12, 0.12])
    cells = snapshots(SMALL, true, 16, snr_db=40.0)

    def median_error(find):
        u = np.sin(np.asarray(find(cells, SMALL)[0]))
        return np.median(np.abs(u[:, None] - true).min(1))

    errors = [median_error(find) for find in (CAPON, MUSIC)]
    assert max(errors) < 0.02 < 0.04 < median_error(directions)


def test_impossible_counts_are_refused():
    with pytest.raises(ValueError, match="samples=1, expected 2 or more"):
        mdl_sources(jnp.ones(4), samples=1)
    narrow = dataclasses.replace(
        SMALL,
        tx_positions=((0, 0),),
        rx_positions=((0, 0), (1, 0)),
        tx_firing_order=(0,),
    )
    with pytest.raises(ValueError, match="has 2 neighbouring elements, expected 3"):
        source_count(jnp.ones((1, 2), complex), narrow)
