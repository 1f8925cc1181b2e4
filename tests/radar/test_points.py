"""Simulated targets come back; TDM phase; flat arrays; batches; gradients; options."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    Scatterers,
    angle_spectrum,
    direction_sines,
    points_and_report,
    power_map,
    radar_points,
    range_doppler,
    strongest_direction,
    strongest_echoes,
    window,
)
from tests.radar.targets import (
    ALL,
    CASCADE,
    CELLS,
    CHIP,
    COLUMN,
    FLAT,
    ONE,
    SMALL,
    STATIC,
    WIDE,
    simulate,
    spherical,
    target,
)

PEAKS = dataclasses.replace(CELLS, peaks=2, capacity=64, false_alarm_rate=1e-12)
AUTO = dataclasses.replace(WIDE, num_azimuth=None)
WIDE_PEAKS = dataclasses.replace(WIDE, peaks=2, capacity=8)


@pytest.mark.parametrize(
    ("radar", "points"),
    [(CHIP, PointSpec()), (CASCADE, WIDE)],
    ids=["single_chip", "cascade"],
)
@pytest.mark.parametrize(
    "truth", [(5.3, 21.0, 8.0, 0.77), (6.6, -33.0, -12.0, -1.31), (2.1, 4.0, 3.0, 1.6)]
)
def test_target_comes_back_within_half_a_bin(radar, points, truth):
    cloud = radar_points(simulate(target(*truth), radar), Radar(radar), points=points)
    distance, azimuth, elevation = (v[0] for v in spherical(cloud.xyz[:1]))
    assert abs(distance - truth[0]) <= radar.range_resolution_m / 2
    assert abs(cloud.velocity[0] - truth[3]) <= radar.velocity_resolution_mps / 2
    u, w = direction_sines(radar, num_azimuth=points.num_azimuth or 64)
    az, el = np.radians(truth[1]), np.radians(truth[2])
    sine = np.sin(azimuth) * np.cos(elevation)
    assert abs(sine - np.sin(az) * np.cos(el)) <= (u[1] - u[0]) / 2
    assert abs(np.sin(elevation) - np.sin(el)) <= (w[1] - w[0]) / 2


@pytest.mark.parametrize("truth", [(5.3, 21.0, 8.0, 0.77), (2.17, -30.0, -9.0, -1.3)])
def test_refined_target_lies_within_a_tenth_of_a_bin(truth):
    # 30 dB above the noise of a cell, summed over 12 antennas.
    cell_noise = (window("hann", 128) ** 2).sum() ** 2
    scatterers = target(*truth, amplitude=np.sqrt(1e3 * cell_noise))
    cloud = radar_points(simulate(scatterers, CHIP), Radar(CHIP), points=PointSpec())
    distance, azimuth, elevation = (v[0] for v in spherical(cloud.xyz[:1]))
    assert abs(distance - truth[0]) < 0.1 * CHIP.range_resolution_m
    assert abs(cloud.velocity[0] - truth[3]) < 0.1 * CHIP.velocity_resolution_mps
    u, w = direction_sines(CHIP)
    az, el = np.radians(truth[1]), np.radians(truth[2])
    sine = np.sin(azimuth) * np.cos(elevation)
    # The array resolves 1/8 of the sine's span over its columns and 1/2 over its rows.
    assert abs(sine - np.sin(az) * np.cos(el)) < 0.1 * (u[1] - u[0]) * 64 / 8
    assert abs(np.sin(elevation) - np.sin(el)) < 0.1 * (w[1] - w[0]) * 32 / 2
    assert 10 * np.log10(cloud.snr[0]) == pytest.approx(30, abs=2)


def close(actual, expected):
    """Compare all fields that the clouds have."""
    pairs = zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5)


def test_without_refinement_points_lie_on_bins():
    cloud = radar_points(simulate(target(5, 20, 5, 1)), Radar(SMALL), points=STATIC)
    valid = np.asarray(cloud.valid)
    distance, _, _ = spherical(cloud.xyz[valid])
    for values, step in (
        (distance, SMALL.range_resolution_m),
        (np.asarray(cloud.velocity)[valid], SMALL.velocity_resolution_mps),
    ):
        assert len(values)
        np.testing.assert_allclose(values / step, np.round(values / step), atol=1e-3)


def test_firing_order_matters_for_a_moving_target():
    radar = dataclasses.replace(SMALL, tx_firing_order=(2, 0, 1))
    cube = simulate(target(5.0, 20.0, 5.0, 2.0), radar)
    right, wrong = (
        spherical(radar_points(cube, Radar(assumed), points=CELLS).xyz[:1])
        for assumed in (radar, SMALL)
    )
    assert abs(right[1] - np.radians(20)) < np.radians(1)
    assert abs(wrong[1] - np.radians(20)) > np.radians(5)


def test_one_row_of_antennas_has_no_elevation():
    cloud = radar_points(simulate(target(5, 20, 0, 1), FLAT), Radar(FLAT), points=CELLS)
    assert cloud.valid.any() and not cloud.xyz[:, 2].any()
    assert abs(spherical(cloud.xyz[:1])[1][0] - np.radians(20)) < np.radians(2)


@pytest.mark.parametrize("peaks", [1, 2])
def test_one_column_of_antennas_has_no_azimuth(peaks):
    points = dataclasses.replace(CELLS, peaks=peaks)
    cloud = radar_points(
        simulate(target(5, 0, 15, 1), COLUMN), Radar(COLUMN), points=points
    )
    assert cloud.valid.any() and not cloud.xyz[:, 1].any()
    assert abs(spherical(cloud.xyz[:1])[2][0] - np.radians(15)) < np.radians(2)


def test_one_antenna_has_no_direction():
    cloud = radar_points(simulate(target(5, 20, 8, 1), ONE), Radar(ONE), points=CELLS)
    assert cloud.valid.any() and not cloud.xyz[:, 1:].any()
    assert abs(cloud.xyz[0, 0] - 5) < ONE.range_resolution_m
    spectrum = angle_spectrum(jnp.ones((3, 1), complex), ONE)
    assert spectrum.shape == (3, 1, 1)
    for angles in strongest_direction(spectrum, ONE):
        assert angles.tolist() == [0, 0, 0]
    music = dataclasses.replace(CELLS, angles="music")
    with pytest.raises(ValueError, match="need neighbouring elements in a row"):
        radar_points(simulate(target(5, 20, 8, 1), ONE), Radar(ONE), points=music)


def test_report_counts_what_the_cloud_does_not_show():
    cube = simulate(target(5, 20, 5, 1))
    few = dataclasses.replace(CELLS, capacity=8)
    cloud, report = points_and_report(cube, Radar(SMALL), points=few)
    every = radar_points(cube, Radar(SMALL), points=CELLS).valid.sum()
    assert cloud.valid.all() and every > 8
    expected = {"detected": every, "dropped": every - 8, "saturated": 0}
    assert report._asdict() == {**expected, "non_finite": 0}
    close(cloud, radar_points(cube, Radar(SMALL), points=few))


def test_report_counts_samples_at_full_scale_and_samples_that_are_no_numbers():
    cube = simulate(target(5, 20, 5, 1))
    cube = cube.at[0, 0, 0, :3].set(32767 - 5j).at[1, 1, 1, 1].set(3 - 32768j)
    _, report = points_and_report(cube, Radar(SMALL), points=CELLS)
    assert (report.saturated, report.non_finite) == (4, 0)
    broken = cube.at[2, 3, 4, 5].set(jnp.nan).at[0, 0, 9, 9].set(jnp.inf)
    cloud, report = points_and_report(broken, Radar(SMALL), points=CELLS)
    assert report.non_finite == 2 and report.detected == 0 and not cloud.valid.any()


def test_points_are_padded_and_strongest_first():
    cube = simulate(target(5, 20, 5, 1))
    cloud = radar_points(cube, Radar(SMALL), points=CELLS)
    assert cloud.xyz.shape == (3000, 3)
    assert 0 < cloud.valid.sum() < 2048 and not cloud.xyz[~cloud.valid].any()
    assert (jnp.diff(cloud.power) <= 0).all()
    everything = radar_points(cube, Radar(SMALL), points=ALL)
    assert everything.valid.sum() == 32 * 61  # without bin 0 and the last two


def test_leakage_that_wraps_around_is_not_a_point():
    leak = target(0.3 * SMALL.range_resolution_m, 0, 0, 0, amplitude=1e4)
    cube = simulate(leak)
    power = np.asarray(range_doppler(cube)[1])
    assert power[16, -1] > 1e3 * np.median(power)  # it does reach the last bin
    cloud = radar_points(cube, Radar(SMALL), points=CELLS)
    distance = np.linalg.norm(cloud.xyz, axis=-1)[cloud.valid]
    assert (distance < SMALL.max_range_m - 2.5 * SMALL.range_resolution_m).all()


@pytest.mark.parametrize(
    ("radar", "degrees", "one_peak", "two_peaks"),
    [(SMALL, (25, -30), CELLS, PEAKS), (CASCADE, (3, -4), WIDE, WIDE_PEAKS)],
    ids=["awr1843", "cascade"],
)
def test_two_targets_in_a_cell_are_two_points(radar, degrees, one_peak, two_peaks):
    distance, (left, right) = 16 * radar.range_resolution_m, np.radians(degrees)
    both = Scatterers(
        xyz=distance * jnp.array([[np.cos(a), np.sin(a), 0] for a in (left, right)]),
        velocity=jnp.zeros(2),
        amplitude=jnp.array([100.0, 90.0]),
    )
    cube = simulate(both, radar)
    one, two = (
        radar_points(cube, Radar(radar), points=p) for p in (one_peak, two_peaks)
    )
    half_a_beam = 1 / (radar.virtual_positions[:, 0].max() + 1)  # in direction sines
    sines = np.sin(spherical(two.xyz[:2])[1])
    np.testing.assert_allclose(sorted(sines), np.sin([right, left]), atol=half_a_beam)
    np.testing.assert_allclose(spherical(two.xyz[:2])[0], distance, rtol=0.01)
    assert two.power[0] == pytest.approx(one.power[0])
    assert two.power[1] > two.power[0] / 4
    np.testing.assert_allclose(two.xyz[0], one.xyz[0], atol=0.1)
    assert two.snr[1] / two.snr[0] == pytest.approx(two.power[1] / two.power[0])
    assert (np.diff(two.power) <= 0).all()


def test_one_target_in_a_cell_is_one_point_with_two_peaks():
    cube = simulate(target(5, 20, 5, 1, amplitude=300.0))
    one = radar_points(cube, Radar(SMALL), points=CELLS)
    two = radar_points(cube, Radar(SMALL), points=PEAKS)
    count = int(two.valid.sum())
    assert 0 < count < 64
    np.testing.assert_allclose(two.power[:count], one.power[:count], rtol=1e-6)
    azimuth, azimuth_of_two = (spherical(cloud.xyz[:1])[1] for cloud in (one, two))
    np.testing.assert_allclose(azimuth, azimuth_of_two, atol=0.01)


def test_vmap_equals_the_loop():
    cubes = [simulate(target(3 + i, 10 * i, 5, 1), seed=i) for i in range(3)]
    points = jax.vmap(lambda cube: radar_points(cube, Radar(SMALL), points=CELLS))
    batch = points(jnp.stack(cubes))
    for i, cube in enumerate(cubes):
        alone = radar_points(cube, Radar(SMALL), points=CELLS)
        assert alone.valid.sum() > 8
        pairs = zip(jax.tree.leaves(alone), jax.tree.leaves(batch), strict=True)
        for one, many in pairs:
            np.testing.assert_allclose(one, many[i], rtol=1e-4, atol=1e-4)


def test_a_wide_array_works_with_default_options():
    cube = simulate(target(5.3, 21.0, 8.0, 0.77), CASCADE)
    wide = dataclasses.replace(WIDE, num_azimuth=256)
    found, expected = (
        radar_points(cube, Radar(CASCADE), points=p) for p in (AUTO, wide)
    )
    assert expected.valid.any()
    close(found, expected)


def test_windows_are_options():
    cube = simulate(target(5.1, 0, 0, 0.3))
    powers = []
    for chosen in (("none", "hann"), ("hamming", "none"), ("blackman", "blackman")):
        windows = dict(zip(("range_window", "doppler_window"), chosen, strict=True))
        points = dataclasses.replace(CELLS, **windows)
        powers.append(radar_points(cube, Radar(SMALL), points=points).power[0])
        expected = power_map(cube, **windows).max()
        assert powers[-1] == pytest.approx(float(expected), rel=1e-5)
    assert len({round(float(power)) for power in powers}) == 3


def test_gradients_reach_the_cube_through_power_and_angles():
    cube = simulate(target(5, 20, 5, 1))

    def summary(parts):
        spectrum, power = range_doppler(jax.lax.complex(*parts))
        cell = jnp.argmax(power)
        snapshot = spectrum.reshape(SMALL.num_virtual, -1)[:, cell]
        azimuth, elevation = strongest_direction(angle_spectrum(snapshot, SMALL), SMALL)
        return jnp.log(power.max()) + azimuth + elevation

    gradient = jax.jit(jax.grad(summary))((cube.real, cube.imag))
    for part in gradient:
        assert jnp.isfinite(part).all() and jnp.abs(part).max() > 0


def test_gradients_of_a_silent_frame_are_finite():
    silence = jnp.zeros(SMALL.cube_shape)

    def total(parts):
        cloud = radar_points(jax.lax.complex(*parts), Radar(SMALL), points=STATIC)
        return sum(jnp.sum(c) for c in (cloud.xyz, cloud.velocity, cloud.snr))

    for part in jax.jit(jax.grad(total))((silence, silence)):
        assert jnp.isfinite(part).all()


def test_strongest_echo_is_the_target_and_others_are_apart():
    cloud = radar_points(simulate(target(5, 20, 0, 1)), Radar(SMALL), points=CELLS)
    first, *others = strongest_echoes(cloud, SMALL)
    assert first.range_m == pytest.approx(5, abs=SMALL.range_resolution_m)
    assert first.azimuth_deg == pytest.approx(20, abs=2)
    assert others
    for echo in others:
        bins = echo.range_bin - first.range_bin, echo.doppler_bin - first.doppler_bin
        assert echo.power_db < first.power_db and max(map(abs, bins)) > 3


def test_options_are_fitted_to_a_radar():
    window = {"guard": (2, 2), "train": (6, 6)}
    fitted = PointSpec(**window, capacity=7).fitted(CASCADE)  # 16 chirps
    assert (fitted.guard, fitted.train) == ((1, 2), (6, 6))
    assert (fitted.num_azimuth, fitted.capacity) == (None, 7)
    cells = CASCADE.num_chirps * CASCADE.num_samples
    assert PointSpec(num_azimuth=256).fitted(CASCADE).num_azimuth == 256
    most = PointSpec(capacity=1 << 20, peaks=2).fitted(CASCADE)
    assert most.capacity == 2 * cells
    assert PointSpec().fitted(CHIP) == PointSpec()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"detector": "xx"}, "detector = 'xx', expected one of"),
        ({"angles": "esprit"}, "angles = 'esprit', expected one of"),
        ({"false_alarm_rate": 1.5}, "false_alarm_rate = 1.5, expected 0 < rate <= 1"),
        ({"capacity": 0}, "capacity = 0, expected 1 to 1,048,576"),
        ({"capacity": 99999999999}, "capacity = 99,999,999,999, expected 1 to 1,0"),
        ({"guard": (-1, 2)}, r"guard = \(-1, 2\), expected two whole numbers"),
        ({"range_window": "kaiser"}, "range_window = 'kaiser', expected one of"),
        ({"num_azimuth": 0}, "num_azimuth = 0, expected 1 to 4,096"),
        ({"edge": "mirror"}, "edge = 'mirror', expected one of"),
        ({"edge": "fill"}, "edge='fill' with kind='os'"),
        ({"factor": -1.0}, "factor = -1.0, expected more than 0"),
        ({"guard": 2}, "guard = 2, expected two whole numbers"),
        ({"train": (4, 4, 4)}, r"train = \(4, 4, 4\), expected two whole numbers"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        PointSpec(**options)


@pytest.mark.usefixtures("as_a_user")
def test_a_window_may_be_a_list():
    assert PointSpec(guard=[1, 2], train=[3, 4]) == PointSpec(
        guard=(1, 2), train=(3, 4)
    )


def test_cube_of_another_radar_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 4, 8, 16\), awr1843 needs"):
        radar_points(jnp.zeros((2, 4, 8, 16), complex), Radar(SMALL))
    with pytest.raises(
        ValueError, match="fewer than the array's 7 rows and 86 columns"
    ):
        angle_spectrum(jnp.zeros(192, complex), RadarSpec.cascade())
    with pytest.raises(
        ValueError, match="8 values per snapshot, awr1843 has 3 tx x 4 rx"
    ):
        angle_spectrum(jnp.zeros(8, complex), SMALL)
