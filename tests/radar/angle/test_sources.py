"""Capon and MUSIC as directions; the number of sources by MDL."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    RadarSpec,
    capon_directions,
    mdl_sources,
    music_directions,
    radar_points,
    source_count,
)
from tests.radar.targets import SMALL, simulate, spherical, target

CHIP, CASCADE = RadarSpec.awr1843(), RadarSpec.cascade()
ONE = PointSpec(detector="ca", capacity=1)


def snapshots(radar, sines, count, snr_db=20.0):
    """Snapshots [cell, virtual] of sources at azimuth sines, with random phases."""
    rng = np.random.default_rng(0)
    columns = radar.virtual_positions[:, 0] * radar.spacing_wavelengths
    noise = rng.normal(size=(2, count, radar.num_virtual))
    wave = np.sqrt(0.5 / 10 ** (snr_db / 10)) * (noise[0] + 1j * noise[1])
    for u in sines:
        phase = rng.uniform(size=(count, 1))
        wave = wave + np.exp(2j * np.pi * (columns * u + phase))
    return jnp.asarray(wave, jnp.complex64)


def test_mdl_is_its_formula():
    rng = np.random.default_rng(0)
    values = 10 ** rng.uniform(-1.0, 1.0, (64, 6))
    counts = np.asarray(mdl_sources(jnp.asarray(values), samples=9))
    assert len({*counts.tolist()}) > 3
    for one, found in zip(values, counts, strict=True):
        falling, lengths = np.sort(one)[::-1], []
        for k in range(6):
            rest = falling[k:]
            ratio = np.log(rest.mean()) - np.log(rest).mean()
            lengths.append(9 * len(rest) * ratio + k * (12 - k) / 2 * np.log(9))
        assert found == np.argmin(lengths)


def test_mdl_counts_independent_sources_of_many_samples():
    rng = np.random.default_rng(1)
    steering = np.exp(1j * np.pi * np.outer(np.arange(6), [-0.6, 0.0, 0.5]))
    for count in range(4):
        parts = rng.normal(size=(2, 40, count, 200))
        noise = rng.normal(size=(2, 40, 6, 200))
        samples = steering[:, :count] @ (parts[0] + 1j * parts[1])
        samples = samples + 0.3 * (noise[0] + 1j * noise[1])
        covariance = samples @ samples.conj().swapaxes(-1, -2) / 200
        found = mdl_sources(jnp.asarray(np.linalg.eigvalsh(covariance)), samples=200)
        assert (np.asarray(found) == count).mean() > 0.95


@pytest.mark.parametrize(
    ("radar", "sines", "share"),
    [
        (CHIP, [], 0.7),
        (CHIP, [0.1], 0.7),
        (CHIP, [-0.2, 0.3], 0.7),
        (CASCADE, [0.1], 0.85),
        (CASCADE, [0.0, 0.02], 0.85),
    ],
)
def test_sources_of_single_snapshots_are_counted(radar, sines, share):
    cells = snapshots(radar, sines, 60)
    found = source_count(cells[:, None], radar)
    assert (np.asarray(found) == len(sines)).mean() > share


@pytest.mark.parametrize(
    "find",
    [capon_directions, lambda s, r: music_directions(s, r, num_sources=None)],
    ids=["capon", "music"],
)
def test_one_target_is_found_where_it_is(find):
    azimuth, elevation = np.radians([[-50, -20, 0, 8, 35], [3, -12, 0, 15, -8]])
    u, w = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    columns, rows = CHIP.virtual_positions.T * CHIP.spacing_wavelengths
    cells = np.exp(2j * np.pi * (np.outer(u, columns) + np.outer(w, rows)))
    found = find(jnp.asarray(cells, jnp.complex64), CHIP)
    np.testing.assert_allclose(found[0], azimuth, atol=np.radians(0.3))
    np.testing.assert_allclose(found[1], elevation, atol=np.radians(0.5))


def test_of_two_targets_in_a_beam_one_is_found():
    true = np.array([-0.12, 0.12])
    for find in (capon_directions, music_directions):
        found, _ = find(snapshots(CHIP, true, 16, snr_db=40.0), CHIP)
        nearest = np.abs(np.sin(found)[:, None] - true).min(1)
        assert np.median(nearest) < 0.02


@pytest.mark.parametrize(
    "changes",
    [{"angles": "capon"}, {"angles": "music"}, {"angles": "music", "sources": 0}],
)
def test_points_have_azimuth_and_elevation(changes):
    points = dataclasses.replace(ONE, **changes)
    cloud = radar_points(simulate(target(5, 20, -6, 1)), SMALL, points=points)
    _, azimuth, elevation = spherical(cloud.xyz)
    np.testing.assert_allclose(np.degrees([azimuth[0], elevation[0]]), [20, -6], atol=1)


def test_impossible_counts_are_refused():
    with pytest.raises(ValueError, match="sources = -1, expected 0 to 64"):
        PointSpec(sources=-1)
    with pytest.raises(ValueError, match="samples=1, expected 2 or more"):
        mdl_sources(jnp.ones(4), samples=1)
    narrow = dataclasses.replace(
        CHIP,
        tx_positions=((0, 0),),
        rx_positions=((0, 0), (1, 0)),
        tx_firing_order=(0,),
    )
    with pytest.raises(ValueError, match="has 2 neighbouring elements, expected 3"):
        source_count(jnp.ones((1, 2), complex), narrow)
