"""Wide arrays against exact distances: angles, power, far targets, points."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import PointSpec, Radar, RadarSpec, all_cells, cell_points
from jradar.radar.angle.direction import directions
from jradar.radar.angle.near_field import focus, focused_directions
from jradar.radar.spectrum import window
from tests.radar.targets import (
    close,
    cloud_of,
    degrees,
    exact_chirp,
    noise,
    place,
    plane_wave,
    single,
    spherical,
)

CASCADE = RadarSpec.cascade(num_chirps=4, idle_time_s=5e-6)
NUM_AZIMUTH = 256


def in_noise(point, radar):
    """A cube of the target."""
    chirp = exact_chirp(radar, point)[:, :, None]
    return single(chirp + noise(*radar.cube_shape) / 10)


def cells_of(truth):
    """Three cells [3, virtual], the middle cell and the target's offset from it."""
    chirp = exact_chirp(CASCADE, place(*truth)).reshape(CASCADE.num_virtual, -1)
    spectrum = np.fft.fft(chirp * window("hann", CASCADE.num_samples))
    exact = truth[0] / CASCADE.range_resolution_m
    cell = round(exact)
    near = single(spectrum[:, cell - 1 : cell + 2].T)
    return near, jnp.int32(cell), jnp.float32(exact - cell)


def beam_power(snapshot, azimuth, elevation):
    """Power of the beam, 1 where all antennas see the whole target in one phase."""
    return abs((snapshot * plane_wave(CASCADE, azimuth, elevation).conj()).mean()) ** 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "most"),
    [
        ((0.5, 0, 0), 0.001),  # whose wave bends most
        ((1.5, 30, 5), 0.03),
        ((3.0, -55, 10), 0.03),
        ((12.0, 50, -4), 0.03),
    ],
)
def test_focused_targets_are_where_they_are_with_all_their_power(truth, most):
    cells, cell, offset = cells_of(truth)
    plain = directions(cells[1], CASCADE, num_azimuth=NUM_AZIMUTH)
    found = focused_directions(cells, cell, offset, CASCADE, num_azimuth=NUM_AZIMUTH)
    error, before = (np.abs(np.degrees(v) - truth[1:]).max() for v in (found, plain))
    assert error < most and error < before
    snapshot = focus(cells, offset, jnp.float32(truth[0]), *found, CASCADE)
    assert beam_power(snapshot, *found) > 0.99
    assert beam_power(cells[1], *plain) < 0.83
    if truth[0] < 1:
        assert before > 1


@pytest.mark.slow
def test_points_of_a_near_target_are_focused():
    truth = (1.2, -25.0, 6.0)
    cube = in_noise(place(*truth), CASCADE)
    window = {"guard": (0, 2), "train": (0, 8), "num_azimuth": NUM_AZIMUTH}
    plain = PointSpec(detector="ca", capacity=2, **window)
    error = []
    for points in (plain, dataclasses.replace(plain, focus=True)):
        cloud = cloud_of(cube, CASCADE, points)
        assert spherical(cloud.xyz[:1])[0] == pytest.approx(truth[0], abs=2e-3)
        error.append(np.abs(degrees(cloud)[0] - truth[1:]).max())
    assert error[1] < 0.05 < 0.2 < error[0]


@pytest.mark.slow
def test_focused_cells_are_the_focused_points():
    """Every cell is a point here, with its fold, which is found before."""
    radar = dataclasses.replace(CASCADE, num_samples=32)
    cube = in_noise(place(4.2 * radar.range_resolution_m, 30.0, 8.0), radar)
    options = {"guard": (0, 2), "train": (0, 4), "false_alarm_rate": 1.0, "folds": 1}
    points = PointSpec(detector="ca", capacity=128, focus=True, **options)
    unit = Radar(radar, range_bias_m=0.1)
    cells = all_cells(cube, unit, points=points)
    expected = cloud_of(cube, unit, points)
    assert expected.valid.sum() == 4 * 29
    close(cell_points(cells, cells.power > 0, unit, points=points), expected, 1e-3)
