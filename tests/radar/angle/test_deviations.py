"""Standard deviations of points, against Monte Carlo and closed forms."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import radar
from jradar.radar.peaks import window_offset
from jradar.radar.spectrum import window
from tests.radar import targets

ONE = radar.PointSpec(detector="ca", capacity=1)
PLAIN = dataclasses.replace(ONE, range_window="none", doppler_window="none")
TRIALS = 256
CELL_NOISE = np.prod([(window("hann", n) ** 2).sum() for n in (32, 64)])  # of SMALL


@functools.partial(jax.jit, static_argnames="points")
def trials(key, scatterers, points):
    """The strongest point of each trial with its own scatterer, and its deviations."""

    def trial(each):
        cube = radar.simulate_cube(*each, targets.SMALL, noise_power=1.0)
        cloud = radar.radar_points(cube, radar.Radar(targets.SMALL), points=points)
        return cloud, radar.point_deviations(cloud, targets.SMALL, points=points)

    each = jax.random.split(key, TRIALS), scatterers
    return jax.lax.map(trial, each, batch_size=16)


def errors_over_deviations(seed, cells, bins, angles, amplitude, points):
    """Those of range, velocity, azimuth and elevation, `[4, trial]`."""
    distance = cells * targets.SMALL.range_resolution_m * np.ones(TRIALS)
    velocity = bins * targets.SMALL.velocity_resolution_mps * np.ones(TRIALS)
    xyz = distance[:, None, None] * targets.place(1.0, *angles)
    truth = xyz, velocity[:, None], np.full((TRIALS, 1), amplitude)
    truth = radar.Scatterers(*(jnp.asarray(values, jnp.float32) for values in truth))
    cloud, deviations = trials(jax.random.key(seed), truth, points)
    found = *targets.spherical(cloud.xyz[:, 0]), np.asarray(cloud.velocity[:, 0])
    errors = np.stack(
        [
            found[0] - distance,
            found[3] - velocity,
            found[1] - np.radians(angles[0]),
            found[2] - np.radians(angles[1]),
        ]
    )
    return errors / np.stack([values[:, 0] for values in deviations])


@pytest.mark.slow
@pytest.mark.parametrize("snr_db", [17, 30])
def test_deviations_are_those_of_monte_carlo(snr_db):
    amplitude = np.sqrt(10 ** (snr_db / 10) * CELL_NOISE)
    ratios = [
        errors_over_deviations(i, *truth, amplitude, ONE)
        for i, truth in enumerate(
            [(9.3, 1.2, (5, 3)), (8.0, 3.4, (-31, -9)), (9.8, -2.7, (24, 8))]
        )
    ]
    # 768 trials know a deviation to 3 %; the trials' noise adds second-order terms.
    spread = np.sqrt((np.stack(ratios) ** 2).mean((0, 2)))
    np.testing.assert_allclose(spread, 1.0, atol=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("snr_db", [10, 20, 30])
def test_the_bias_without_windows_is_part_of_the_deviations(snr_db):
    """Targets anywhere between bins: noise alone would be up to 13 times too small."""
    amplitude = np.sqrt(10 ** (snr_db / 10) / (32 * 64))
    between = np.random.default_rng(snr_db).uniform(-0.5, 0.5, (2, TRIALS))
    where = 9.0 + between[0], 2.0 + between[1], (0, 0)
    ratios = errors_over_deviations(snr_db, *where, amplitude, PLAIN)[:2]
    spread = np.sqrt((ratios**2).mean(1))
    assert (0.9 < spread).all() and (spread < 1.2).all(), spread


@pytest.mark.parametrize("kind", ["hann", "blackman"])
@pytest.mark.parametrize("length", [16, 128])
def test_a_target_between_bins_is_placed_without_bias(kind, length):
    offset = np.linspace(-0.5, 0.5, 41)
    phase = 2j * np.pi * np.outer(offset, np.arange(length)) / length
    power = abs(np.fft.fft(window(kind, length) * np.exp(phase))) ** 2
    powers = [jnp.asarray(power[:, k]) for k in (-1, 0, 1)]
    corrected = window_offset(*powers, kind=kind, length=length)
    np.testing.assert_allclose(corrected, offset, atol=1e-4)


def test_angles_follow_the_arrays_aperture():
    # One row of n: var(u) = 6 / (snr n (n^2 - 1) (2 pi d)^2), here for 8 columns.
    cube = targets.simulate(targets.target(5, 20, 0, 1), targets.FLAT)
    cloud = targets.cloud_of(cube, targets.FLAT)
    found = radar.point_deviations(cloud, targets.FLAT, points=targets.CELLS)
    snr, turn = float(cloud.snr[0]) - 1, 2 * np.pi * targets.FLAT.spacing_wavelengths
    of_sine = np.sqrt(6 / (snr * 8 * 63)) / turn
    expected = of_sine / np.cos(np.radians(20))
    assert expected < found.azimuth[0] < 1.1 * expected  # and the phase of the turns
    assert np.isinf(found.elevation[0])


def test_padding_and_clouds_without_deviations():
    cloud = targets.cloud_of(targets.simulate(targets.target(5, 20, 5, 1)))
    for values in map(np.asarray, radar.point_deviations(cloud, targets.SMALL)):
        assert np.isfinite(values[cloud.valid]).all()
        assert np.isinf(values[~cloud.valid]).all()
    with pytest.raises(ValueError, match="the cloud has no snr"):
        radar.point_deviations(cloud._replace(snr=None), targets.SMALL)
    on_bins = dataclasses.replace(ONE, refine=False)
    with pytest.raises(ValueError, match="refine = False: such points lie on bins"):
        radar.point_deviations(cloud, targets.SMALL, points=on_bins)
