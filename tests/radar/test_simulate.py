"""The forward model: the exact phase within its bound, superposition, noise power."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, Scatterers, simulate_cube

RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=16, tx_firing_order=(0, 2, 1))
KEY = jax.random.key(0)
C = 299_792_458.0


def scatterers(xyz, velocity, amplitude):
    return Scatterers(
        *(jnp.asarray(v, jnp.float32) for v in (xyz, velocity, amplitude))
    )


def test_phase_is_the_closed_form_in_float64():
    xyz, velocity = np.array([4.0, 1.5, -0.7]), 1.3
    cube = simulate_cube(KEY, scatterers([xyz], [velocity], [2.0]), RADAR)
    distance = np.linalg.norm(np.float32(xyz).astype(float))
    _, u, w = xyz / distance
    for t, r, c, n in [(0, 0, 0, 0), (1, 2, 5, 7), (2, 3, 7, 15), (2, 0, 1, 3)]:
        place = [0, 2, 1][t]  # when this transmitter fires
        time_s = (3 * c + place - 3 * 8 / 2) * RADAR.chirp_period_s
        now = distance + velocity * time_s
        a, e = np.add(RADAR.tx_positions[t], RADAR.rx_positions[r])
        sample_s = RADAR.adc_start_time_s + n / RADAR.sample_rate_hz
        frequency = RADAR.start_frequency_hz + RADAR.slope_hz_per_s * sample_s
        cycles = 2 * now / C * frequency
        cycles += RADAR.spacing_wavelengths * (a * u + e * w)
        # float32 positions carry 5e-7 m, some 1e-4 of the 3.8 mm wavelength.
        np.testing.assert_allclose(
            cube[t, r, c, n], 2 * np.exp(2j * np.pi * cycles), atol=1e-2
        )


def exact(xyz, departure, velocity, radar):
    """One scatterer of amplitude 1 by the definition, in float64, sample by sample."""
    legs = [
        np.linalg.norm(np.asarray(p, np.float32).astype(float))
        for p in (xyz, departure)
    ]
    tx, rx = np.array(radar.tx_positions), np.array(radar.rx_positions)
    antennas = (tx @ departure[1:] / legs[1])[:, None] + rx @ xyz[1:] / legs[0]
    time_s = radar.turn_period_s * np.arange(radar.num_chirps)
    time_s = time_s + radar.chirp_period_s * radar.firing_position[:, None]
    time_s = time_s - radar.turn_period_s * radar.num_chirps / 2
    now = np.mean(legs) + np.float64(np.float32(velocity)) * time_s
    sample_s = (
        radar.adc_start_time_s + np.arange(radar.num_samples) / radar.sample_rate_hz
    )
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * sample_s
    cycles = 2 * now[:, None, :, None] / C * frequency
    cycles = cycles + radar.spacing_wavelengths * antennas[:, :, None, None]
    return np.exp(2j * np.pi * cycles)


@pytest.mark.parametrize(
    "radar",
    [
        RadarSpec.awr1843(num_chirps=16, tx_firing_order=(0, 2, 1)),
        RadarSpec.cascade(num_chirps=8),
    ],
    ids=lambda radar: f"{radar.name}-{radar.num_chirps}",
)
def test_whole_cube_is_the_exact_one_within_the_stated_bound(radar):
    xyz, departure = np.array([3.0, 1.5, -0.7]), np.array([2.0, -6.0, 0.4])
    moving = scatterers([xyz], [radar.max_velocity_mps], [1.0])
    moving = moving._replace(departure=jnp.asarray(departure[None], jnp.float32))
    error = simulate_cube(KEY, moving, radar) - exact(
        xyz, departure, radar.max_velocity_mps, radar
    )
    still = scatterers([xyz], [0.0], [1.0])
    rounding = np.abs(
        simulate_cube(KEY, still, radar) - exact(xyz, xyz, 0.0, radar)
    ).max()
    assert rounding < 6e-3  # float32 phases of some 5,000 turns, no block at work
    assert np.abs(error).max() < 6e-3 + rounding


def test_a_departure_at_the_same_place_changes_nothing():
    plain = scatterers([[3, 1, 0.2], [2, -1, 0]], [0.5, -0.4], [1, 2])
    cube = simulate_cube(KEY, plain, RADAR)
    same = simulate_cube(KEY, plain._replace(departure=plain.xyz), RADAR)
    np.testing.assert_allclose(cube, same, atol=1e-4)


def test_scatterers_add_up_and_padding_is_silent():
    both = scatterers([[3, 0, 0], [2, 1, 0], [0, 0, 0]], [0, 1, 0], [1, 2, 0])
    alone = [
        simulate_cube(KEY, jax.tree.map(lambda x, i=i: x[i : i + 1], both), RADAR)
        for i in range(2)
    ]
    total = simulate_cube(KEY, both, RADAR)
    np.testing.assert_allclose(total, alone[0] + alone[1], atol=1e-4)


def test_places_may_be_those_at_the_first_chirp():
    velocity = np.array([0.5, -0.4])
    there = scatterers([[3, 1, 0.2], [2, -1, 0]], velocity, [1, 2])
    distance = np.linalg.norm(there.xyz, axis=-1, keepdims=True)
    moved = velocity[:, None] * RADAR.turn_period_s * RADAR.num_chirps / 2
    at_start = there._replace(
        xyz=jnp.asarray(there.xyz * (1 - moved / distance), jnp.float32)
    )
    middle, start = (
        simulate_cube(KEY, there, RADAR),
        simulate_cube(KEY, at_start, RADAR, at="start"),
    )
    np.testing.assert_allclose(start, middle, atol=0.02)
    assert np.abs(simulate_cube(KEY, there, RADAR, at="start") - middle).max() > 0.5
    with pytest.raises(ValueError, match="at='end', expected one of"):
        simulate_cube(KEY, there, RADAR, at="end")


def test_noise_has_the_power_asked_for():
    silence = scatterers([[1, 0, 0]], [0], [0])
    noise = simulate_cube(KEY, silence, RadarSpec.awr1843(), noise_power=9.0)
    np.testing.assert_allclose((jnp.abs(noise) ** 2).mean(), 9.0, rtol=0.02)


def test_gradient_reaches_the_scatterers():
    scene = scatterers([[3, 1, 0.2]], [0.5], [1])
    scene = scene._replace(departure=scene.xyz + 0.5)
    gradient = jax.grad(lambda s: jnp.abs(simulate_cube(KEY, s, RADAR).sum()) ** 2)(
        scene
    )
    assert all(jnp.isfinite(g).all() for g in gradient)
    assert all(jnp.abs(g).max() > 0 for g in gradient)


@pytest.mark.parametrize("departure", [None, [0.5, -0.6, 0.2]], ids=["direct", "apart"])
def test_spherical_waves_have_the_path_of_each_antenna(departure):
    radar = RadarSpec.cascade(num_chirps=2, num_samples=32)
    xyz = np.array([0.7, 0.5, -0.2])
    scale = np.array([radar.spacing_wavelengths, radar.row_spacing_wavelengths])
    tx, rx = (
        -radar.wavelength_m * scale * p
        for p in (radar.tx_positions, radar.rx_positions)
    )
    middle = (tx.mean(0) + rx.mean(0)) / 2
    legs = [
        np.hypot(place[0], np.linalg.norm(place[1:] - antennas + middle, axis=-1))
        for place, antennas in (
            (xyz if departure is None else departure, tx),
            (xyz, rx),
        )
    ]
    sample_s = radar.adc_start_time_s + np.arange(32) / radar.sample_rate_hz
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * sample_s
    delay = (legs[0][:, None] + legs[1]) / C
    expected = np.exp(2j * np.pi * delay[..., None] * frequency)
    still = scatterers([xyz], [0.0], [1.0])
    if departure is not None:
        still = still._replace(departure=jnp.asarray([departure], jnp.float32))
    cube = simulate_cube(KEY, still, radar, spherical=True)
    np.testing.assert_allclose(cube[:, :, 0], expected, atol=6e-3)
    np.testing.assert_allclose(cube[:, :, 1], expected, atol=6e-3)
    plane = simulate_cube(KEY, still, radar)[:, :, 0]
    beam = np.abs((np.asarray(plane) * expected.conj()).mean((0, 1)))
    assert beam.max() < 0.8  # the wave's front is bent


def test_far_spherical_waves_are_plane():
    far = scatterers([[40.0, 9.0, -4.0], [30.0, -20.0, 2.0]], [0.4, -0.2], [1.0, 2.0])
    cube = simulate_cube(KEY, far, RADAR, spherical=True)
    for i in range(2):
        one = jax.tree.map(lambda x, i=i: x[i : i + 1], far)
        plane = np.asarray(simulate_cube(KEY, one, RADAR))
        near = np.asarray(simulate_cube(KEY, one, RADAR, spherical=True))
        turn = (near * plane.conj()).mean()  # the origin is another antenna
        turn /= abs(turn)
        np.testing.assert_allclose(near, plane * turn, atol=0.03 * far.amplitude[i])
        cube = cube - near
    np.testing.assert_allclose(cube, 0, atol=1e-4)
