"""Simulated targets come back; TDM phase; flat arrays; batches; gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    RadarSpec,
    Scatterers,
    angle_spectrum,
    direction_sines,
    noise_gain,
    radar_points,
    range_doppler,
    simulate_cube,
    strongest_direction,
)

SMALL = RadarSpec.awr1843(num_chirps=32, num_samples=64)
CASCADE_WINDOW = {"guard": (1, 2), "train": (2, 4), "num_azimuth": 128}


def target(distance, azimuth_deg, elevation_deg, velocity, amplitude=100.0):
    az, el = np.radians(azimuth_deg), np.radians(elevation_deg)
    direction = [np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)]
    return Scatterers(
        xyz=jnp.asarray(distance * np.array([direction]), jnp.float32),
        velocity=jnp.array([velocity], jnp.float32),
        amplitude=jnp.array([amplitude], jnp.float32),
    )


def spherical(xyz):
    x, y, z = np.asarray(xyz, np.float64).T
    distance = np.sqrt(x**2 + y**2 + z**2)
    return distance, np.arctan2(y, x), np.arcsin(z / distance)


@pytest.mark.parametrize(
    ("radar", "options"),
    [(RadarSpec.awr1843(), {}), (SMALL, {}), (RadarSpec.cascade(), CASCADE_WINDOW)],
    ids=["single_chip", "small", "cascade"],
)
@pytest.mark.parametrize(
    "truth", [(5.3, 21.0, 8.0, 0.77), (6.6, -33.0, -12.0, -1.31), (2.1, 4.0, 3.0, 1.6)]
)
def test_target_comes_back_within_half_a_bin(radar, options, truth):
    scatterers = target(*truth)
    cube = simulate_cube(jax.random.key(0), scatterers, radar, noise_power=1.0)
    cloud = radar_points(cube, radar, **options)
    distance, azimuth, elevation = (v[0] for v in spherical(cloud.xyz[:1]))
    # The target moves during the frame: the spectra show it in the frame's middle.
    frame_s = radar.turn_period_s * radar.num_chirps
    middle = truth[0] + truth[3] * frame_s / 2
    assert abs(distance - middle) <= radar.range_resolution_m / 2
    assert abs(cloud.velocity[0] - truth[3]) <= radar.velocity_resolution_mps / 2
    u, w = direction_sines(radar, num_azimuth=options.get("num_azimuth", 64))
    az, el = np.radians(truth[1]), np.radians(truth[2])
    sine = np.sin(azimuth) * np.cos(elevation)
    assert abs(sine - np.sin(az) * np.cos(el)) <= (u[1] - u[0]) / 2
    assert abs(np.sin(elevation) - np.sin(el)) <= (w[1] - w[0]) / 2


@pytest.mark.parametrize("truth", [(5.3, 21.0, 8.0, 0.77), (2.17, -30.0, -9.0, -1.3)])
def test_refined_target_lies_within_a_tenth_of_a_bin(truth):
    radar = RadarSpec.awr1843()
    # 30 dB over the noise of a cell, summed over 12 antennas.
    cell_noise = noise_gain("hann", 128) ** 2
    cube = simulate_cube(
        jax.random.key(0), target(*truth, amplitude=1.0), radar,
        noise_power=1e-3 / cell_noise,
    )  # fmt: skip
    cloud = radar_points(cube, radar)
    middle = truth[0] + truth[3] * radar.turn_period_s * radar.num_chirps / 2
    distance, azimuth, elevation = (v[0] for v in spherical(cloud.xyz[:1]))
    assert abs(distance - middle) < 0.1 * radar.range_resolution_m
    assert abs(cloud.velocity[0] - truth[3]) < 0.1 * radar.velocity_resolution_mps
    u, w = direction_sines(radar)
    az, el = np.radians(truth[1]), np.radians(truth[2])
    sine = np.sin(azimuth) * np.cos(elevation)
    # The array resolves 1/8 of the sine's span over its columns and 1/2 over its rows.
    assert abs(sine - np.sin(az) * np.cos(el)) < 0.1 * (u[1] - u[0]) * 64 / 8
    assert abs(np.sin(elevation) - np.sin(el)) < 0.1 * (w[1] - w[0]) * 32 / 2
    assert 10 * np.log10(cloud.snr[0]) == pytest.approx(30, abs=2)


def test_without_refinement_points_lie_on_bins():
    cube = simulate_cube(jax.random.key(0), target(5, 20, 5, 1), SMALL, noise_power=1.0)
    cloud = radar_points(cube, SMALL, refine=False)
    valid = np.asarray(cloud.valid)
    distance, _, _ = spherical(cloud.xyz[valid])
    for values, step in (
        (distance, SMALL.range_resolution_m),
        (np.asarray(cloud.velocity)[valid], SMALL.velocity_resolution_mps),
    ):
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-3)


def test_firing_order_matters_for_a_moving_target():
    radar = RadarSpec.awr1843(num_chirps=32, tx_firing_order=(2, 0, 1))
    scatterers = target(5.0, 20.0, 5.0, 2.0)
    cube = simulate_cube(jax.random.key(0), scatterers, radar)
    right = spherical(radar_points(cube, radar).xyz[:1])
    wrong = spherical(radar_points(cube, RadarSpec.awr1843(num_chirps=32)).xyz[:1])
    assert abs(right[1] - np.radians(20)) < np.radians(1)
    assert abs(wrong[1] - np.radians(20)) > np.radians(5)


def test_one_row_of_antennas_has_no_elevation():
    radar = RadarSpec.awr1642(num_chirps=32)
    cube = simulate_cube(jax.random.key(0), target(5, 20, 0, 1), radar, noise_power=1.0)
    cloud = radar_points(cube, radar)
    assert cloud.valid.any() and not cloud.xyz[:, 2].any()
    assert abs(spherical(cloud.xyz[:1])[1][0] - np.radians(20)) < np.radians(2)


def test_points_are_padded_and_strongest_first():
    cube = simulate_cube(jax.random.key(0), target(5, 20, 5, 1), SMALL, noise_power=1.0)
    cloud = radar_points(cube, SMALL, capacity=3000)
    assert cloud.xyz.shape == (3000, 3)
    assert 0 < cloud.valid.sum() < 2048 and not cloud.xyz[~cloud.valid].any()
    assert (jnp.diff(cloud.power) <= 0).all()
    everything = radar_points(cube, SMALL, capacity=3000, false_alarm_rate=1.0)
    assert everything.valid.sum() == 32 * 61  # all but range 0 and what wraps to it


def test_leakage_that_wraps_around_is_no_point():
    leak = target(0.3 * SMALL.range_resolution_m, 0, 0, 0)
    cube = simulate_cube(jax.random.key(0), leak, SMALL, noise_power=1e-4)
    power = np.asarray(range_doppler(cube)[1])
    assert power[16, -1] > 1e3 * np.median(power)  # it does reach the last bin
    cloud = radar_points(cube, SMALL, false_alarm_rate=1e-6)
    distance = np.linalg.norm(cloud.xyz, axis=-1)[cloud.valid]
    assert (distance < SMALL.max_range_m - 2.5 * SMALL.range_resolution_m).all()


@pytest.mark.parametrize(
    ("radar", "degrees", "options"),
    [
        (SMALL, (25, -30), {}),
        (RadarSpec.cascade(), (3, -4), CASCADE_WINDOW),
    ],
    ids=["awr1843", "cascade"],
)
def test_two_targets_in_a_cell_are_two_points(radar, degrees, options):
    distance, (left, right) = 16 * radar.range_resolution_m, np.radians(degrees)
    both = Scatterers(
        xyz=distance * jnp.array([[np.cos(a), np.sin(a), 0] for a in (left, right)]),
        velocity=jnp.zeros(2),
        amplitude=jnp.array([100.0, 90.0]),
    )
    cube = simulate_cube(jax.random.key(0), both, radar, noise_power=1.0)

    options = {"capacity": 8, "detector": "ca", **options}
    one, two = (radar_points(cube, radar, peaks=n, **options) for n in (1, 2))
    half_a_beam = 1 / (radar.virtual_positions[:, 0].max() + 1)  # in direction sines
    sines = np.sin(spherical(two.xyz[:2])[1])
    np.testing.assert_allclose(sorted(sines), np.sin([right, left]), atol=half_a_beam)
    np.testing.assert_allclose(spherical(two.xyz[:2])[0], distance, rtol=0.01)
    assert two.power[0] == pytest.approx(one.power[0])
    assert two.power[1] > two.power[0] / 4
    np.testing.assert_allclose(two.xyz[0], one.xyz[0], atol=0.1)
    assert two.snr[1] / two.snr[0] == pytest.approx(two.power[1] / two.power[0])
    assert (np.diff(two.power) <= 0).all()


def test_vmap_equals_the_loop():
    keys = jax.random.split(jax.random.key(0), 3)
    cubes = jnp.stack(
        [
            simulate_cube(key, target(3 + i, 10 * i, 5, 1), SMALL, noise_power=1.0)
            for i, key in enumerate(keys)
        ]
    )
    batch = jax.vmap(lambda cube: radar_points(cube, SMALL, capacity=16))(cubes)
    for i, cube in enumerate(cubes):
        alone = radar_points(cube, SMALL, capacity=16)
        for one, many in zip(alone, batch, strict=True):
            np.testing.assert_allclose(one, many[i], rtol=1e-4, atol=1e-4)


def test_one_target_in_a_cell_is_one_point_however_many_are_looked_for():
    cube = simulate_cube(jax.random.key(0), target(5, 20, 5, 1), SMALL, noise_power=0.1)
    options = {"capacity": 64, "detector": "ca", "false_alarm_rate": 1e-12}
    one = radar_points(cube, SMALL, **options)
    three = radar_points(cube, SMALL, peaks=3, **options)
    assert 0 < one.valid.sum() < 64
    np.testing.assert_array_equal(one.valid, three.valid)
    np.testing.assert_allclose(one.power, three.power, rtol=1e-6)
    azimuth, azimuth_of_three = (spherical(cloud.xyz[:1])[1] for cloud in (one, three))
    np.testing.assert_allclose(azimuth, azimuth_of_three, atol=0.01)


def test_gradients_reach_the_cube_through_power_and_angles():
    cube = simulate_cube(jax.random.key(0), target(5, 20, 5, 1), SMALL, noise_power=1.0)

    def summary(parts):
        spectrum, power = range_doppler(jax.lax.complex(*parts))
        cell = jnp.argmax(power)
        snapshot = spectrum.reshape(SMALL.num_virtual, -1)[:, cell]
        azimuth, elevation = strongest_direction(angle_spectrum(snapshot, SMALL), SMALL)
        return jnp.log(power.max()) + azimuth + elevation

    gradient = jax.grad(summary)((cube.real, cube.imag))
    for part in gradient:
        assert jnp.isfinite(part).all() and jnp.abs(part).max() > 0


def test_cube_of_another_radar_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 4, 8, 16\), awr1843 needs"):
        radar_points(jnp.zeros((2, 4, 8, 16), complex), SMALL)
    with pytest.raises(ValueError, match="detector='xx', expected one of"):
        radar_points(jnp.zeros(SMALL.cube_shape, complex), SMALL, detector="xx")
    with pytest.raises(
        ValueError, match="fewer than the array's 7 rows and 86 columns"
    ):
        angle_spectrum(jnp.zeros(192, complex), RadarSpec.cascade())
    with pytest.raises(ValueError, match="8 values per cell, awr1843 has 3 tx x 4 rx"):
        angle_spectrum(jnp.zeros(8, complex), SMALL)
