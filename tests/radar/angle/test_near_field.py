"""Wide arrays against exact distances: angles, power, far targets, points."""

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    all_cells,
    cell_points,
    detect,
    directions,
    focus,
    focused_directions,
    radar_points,
    window,
)
from tests.radar.targets import spherical

CASCADE = RadarSpec.cascade(num_chirps=4, idle_time_s=5e-6)
LIGHT = 299_792_458.0
NUM_AZIMUTH = 256


def place(distance, azimuth_deg, elevation_deg):
    az, el = np.radians([azimuth_deg, elevation_deg])
    direction = np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)
    return distance * np.array(direction)


def exact_chirp(point, radar=CASCADE):
    """Samples [tx, rx, sample] of a target that stands still, from its distances."""
    metres = radar.wavelength_m * np.array(
        [radar.spacing_wavelengths, radar.row_spacing_wavelengths]
    )
    tx, rx = (-np.array(p) * metres for p in (radar.tx_positions, radar.rx_positions))
    middle = (tx.mean(0) + rx.mean(0)) / 2
    legs = [
        np.sqrt(point[0] ** 2 + ((point[1:] - a + middle) ** 2).sum(1))
        for a in (tx, rx)
    ]
    delay = (legs[0][:, None] + legs[1]) / LIGHT
    time = radar.adc_start_time_s + np.arange(radar.num_samples) / radar.sample_rate_hz
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * time
    return np.exp(2j * np.pi * delay[..., None] * frequency)


@functools.cache
def cells_of(*spherical_place):
    """Three cells [3, virtual], the middle cell and the target's offset from it."""
    chirp = exact_chirp(place(*spherical_place)).reshape(CASCADE.num_virtual, -1)
    spectrum = np.fft.fft(chirp * window("hann", CASCADE.num_samples))
    exact = spherical_place[0] / CASCADE.range_resolution_m
    cell = round(exact)
    near = jnp.asarray(spectrum[:, cell - 1 : cell + 2].T, jnp.complex64)
    return near, jnp.int32(cell), jnp.float32(exact - cell)


def beam_power(snapshot, azimuth, elevation):
    """Power of the beam, 1 where all antennas see the whole target in one phase."""
    columns, rows = CASCADE.virtual_positions.T * CASCADE.spacing_wavelengths
    u, w = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    beam = np.asarray(snapshot) * np.exp(-2j * np.pi * (columns * u + rows * w))
    return abs(beam.mean()) ** 2


@pytest.mark.parametrize(
    "truth", [(0.8, 0, 0), (1.5, 30, 5), (3.0, -55, 10), (12.0, 50, -4)]
)
def test_focused_targets_are_where_they_are_with_all_their_power(truth):
    cells, cell, offset = cells_of(*truth)
    plain = directions(cells[1], CASCADE, num_azimuth=NUM_AZIMUTH)
    found = focused_directions(cells, cell, offset, CASCADE, num_azimuth=NUM_AZIMUTH)
    error, before = (np.abs(np.degrees(v) - truth[1:]).max() for v in (found, plain))
    assert error < 0.03 and error < before
    snapshot = focus(cells, offset, jnp.float32(truth[0]), *found, CASCADE)
    assert beam_power(snapshot, *found) > 0.99
    assert beam_power(cells[1], *plain) < 0.83
    if truth[0] < 1:
        assert before > 1


def test_a_narrow_array_needs_no_focus():
    # A plane wave across 8 columns, 10 m away: nothing to take out.
    radar = RadarSpec.awr1642()
    columns = radar.virtual_positions[:, 0] * radar.spacing_wavelengths
    wave = np.exp(2j * np.pi * columns * 0.4)
    cells = jnp.asarray(np.stack([-0.5 * wave, wave, -0.5 * wave]), jnp.complex64)
    cell = jnp.int32(round(10 / radar.range_resolution_m))
    found = focused_directions(cells, cell, jnp.float32(0.0), radar)
    plain = directions(cells[1], radar)
    np.testing.assert_allclose(found, plain, atol=2e-3)


def test_points_of_a_near_target_are_focused():
    truth = (1.2, -25.0, 6.0)
    chirp = exact_chirp(place(*truth))
    noise = np.random.default_rng(0).normal(size=(2, *CASCADE.cube_shape)) / 10
    cube = jnp.asarray(chirp[:, :, None] + noise[0] + 1j * noise[1], jnp.complex64)
    plain = PointSpec(
        detector="ca", guard=(0, 2), train=(0, 8), capacity=2, num_azimuth=NUM_AZIMUTH
    )
    error = []
    for points in (plain, dataclasses.replace(plain, focus=True)):
        cloud = radar_points(cube, Radar(CASCADE), points=points)
        found = spherical(cloud.xyz[:1])
        assert found[0][0] == pytest.approx(truth[0], abs=2e-3)
        error.append(np.abs(np.degrees([found[1][0], found[2][0]]) - truth[1:]).max())
    assert error[1] < 0.05 < 0.2 < error[0]


def test_focused_cells_are_the_focused_points():
    radar = RadarSpec.cascade(num_chirps=4, idle_time_s=5e-6, num_samples=32)
    distance = 4.2 * radar.range_resolution_m
    chirp = exact_chirp(place(distance, 30.0, 8.0), radar)[:, :, None]
    noise = np.random.default_rng(0).normal(size=(2, *radar.cube_shape)) / 10
    cube = jnp.asarray(chirp + noise[0] + 1j * noise[1], jnp.complex64)
    points = PointSpec(
        detector="ca", guard=(0, 2), train=(0, 4), capacity=8, focus=True
    )
    unit = Radar(radar, range_bias_m=0.1)
    cells = all_cells(cube, unit, points=points)
    mask = detect(cells.power, radar, points=points)
    found = cell_points(cells, mask, unit, points=points)
    expected = radar_points(cube, unit, points=points)
    assert expected.valid.any()
    np.testing.assert_allclose(found.xyz, expected.xyz, atol=1e-4)


def test_a_focus_has_one_direction():
    for changes in ({"angles": "music"}, {"peaks": 2}):
        with pytest.raises(ValueError, match="expected 'fft' and 1: a focus has one"):
            PointSpec(focus=True, **changes)
