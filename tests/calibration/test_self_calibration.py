"""Self-calibration: channels are found, what is hidden stays, bad echoes, errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.calibration import self_calibrate
from jradar.calibration.self_calibration import (
    channel_response,
    linear_phases,
    steering,
    without_tilt,
)
from jradar.calibration.snapshots import Snapshots, strong_snapshots
from jradar.radar import Radar, RadarSpec, Scatterers, calibrate, simulate_cube
from tests.directions import unit

CHIP = RadarSpec.awr1843(num_chirps=16, num_samples=128)
FLAT = RadarSpec.awr1642(num_chirps=16, num_samples=128)
SHARED = (
    *("slope_hz_per_s", "sample_rate_hz", "num_samples", "num_chirps"),
    *("idle_time_s", "adc_start_time_s", "ramp_end_time_s"),
)
CHIRP = {field: getattr(CHIP, field) for field in SHARED}
ODS = RadarSpec.named("iwr6843ods", **CHIRP, start_frequency_hz=60e9)


def scatterers(seed, *, count=12, fastest=1.0):
    """Echoes anywhere in the view, some of which share a cell."""
    random = np.random.default_rng(seed)
    azimuth = np.radians(random.uniform(-50, 50, count))
    direction = unit(azimuth, np.radians(random.uniform(-15, 15, count)))
    distance = random.uniform(1, 12, (count, 1))
    return Scatterers(
        jnp.asarray(distance * direction, jnp.float32),
        jnp.asarray(random.uniform(-fastest, fastest, count), jnp.float32),
        jnp.asarray(random.uniform(20, 100, count), jnp.float32),
    )


def channels(radar, degrees, *, seed=0, decibels=1.0, pairs=False):
    """Responses `[virtual]`: of tx times rx, or of each pair."""
    random = np.random.default_rng(seed)

    def errors(shape, share=1.0):
        gain = 10 ** (share * decibels * random.standard_normal(shape) / 20)
        phase = np.radians(share * degrees * random.standard_normal(shape))
        return gain * np.exp(1j * phase)

    if pairs:
        return errors(radar.num_virtual)
    half = 0.5**0.5
    tx, rx = errors((radar.num_tx, 1), half), errors(radar.num_rx, half)
    return (tx * rx).ravel()


def echoes_of(radar, response, *, frames=6, noise=0.02, several=0.3, seed=0):
    """Snapshots of 20 echoes a frame through the channels, some of two echoes each."""
    random = np.random.default_rng(seed)
    shape = (frames, 20, 2)
    az, el = random.uniform(-0.8, 0.8, shape), random.uniform(-0.2, 0.2, shape)
    amplitude = np.exp(2j * np.pi * random.random(shape))
    amplitude[..., 1] *= random.random(shape[:2]) < several
    waves = np.asarray(steering(jnp.asarray(az), jnp.asarray(el), radar))
    snapshot = (waves * amplitude[..., None]).sum(2) * response
    parts = random.standard_normal((2, *snapshot.shape)) * noise / 2**0.5
    return Snapshots(
        jnp.asarray(snapshot + parts[0] + 1j * parts[1], jnp.complex64),
        jnp.asarray(random.uniform(1, 12, shape[:2]), jnp.float32),
        jnp.zeros(shape[:2]),
        jnp.ones(shape[:2]),
    )


def simulated_echoes(radar, response, *, frames=6, noise_power=100.0, spot=None):
    """Strong echoes of simulated cubes; `spot` is the place of a still reflector."""
    found = []
    for frame in range(frames):
        scene = scatterers(frame)
        if spot is not None:
            scene = Scatterers(
                scene.xyz.at[0].set(jnp.asarray(spot)),
                scene.velocity.at[0].set(0.0),
                scene.amplitude.at[0].set(300.0),
            )
        cube = simulate_cube(jax.random.key(frame), scene, radar)
        cube = calibrate(cube, Radar(radar).with_factors(response))
        noise = np.random.default_rng(frame).standard_normal((2, *radar.cube_shape))
        cube += (noise_power / 2) ** 0.5 * (noise[0] + 1j * noise[1])
        found.append(strong_snapshots(cube, Radar(radar), count=20))
    return jax.tree.map(lambda *columns: jnp.stack(columns), *found)


def remaining_deg(radar, response):
    """Root mean square of the phases that snapshots show."""
    shown = without_tilt(jnp.asarray(response, jnp.complex64), radar)
    return np.degrees(np.sqrt(np.mean(np.angle(shown) ** 2)))


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [17, 34])
def test_channels_of_simulated_cubes_are_found(degrees):
    true = channels(CHIP, degrees, seed=degrees)
    found = self_calibrate(simulated_echoes(CHIP, true), CHIP)
    left = found.factors * true
    assert remaining_deg(CHIP, true) > 5
    assert remaining_deg(CHIP, left) < 1
    assert np.std(20 * np.log10(np.abs(left))) < 0.15
    assert found.improves and found.separable
    assert found.after.phase_deg < 2 < found.before.phase_deg
    assert found.after.power_share < 0.1 * found.before.power_share
    assert found.after.peak_to_mean > found.before.peak_to_mean


@pytest.mark.parametrize("radar", [FLAT, ODS], ids=lambda radar: radar.name)
def test_channels_of_other_arrays_are_found(radar):
    true = channels(radar, 25)
    snapshot = echoes_of(radar, true).snapshot.reshape(-1, radar.num_virtual)
    response = np.asarray(channel_response(snapshot, radar, separable=True))
    assert remaining_deg(radar, true) > 5
    assert remaining_deg(radar, true / response) < 1


def test_the_uncertainty_covers_the_error_and_grows_with_the_noise():
    true = channels(CHIP, 17)
    noises = (0.02, 0.2)
    fits = [self_calibrate(echoes_of(CHIP, true, noise=n), CHIP) for n in noises]
    for fit in fits:
        error = remaining_deg(CHIP, fit.factors * true)
        assert error < 4 * fit.uncertainty_deg < 40
    assert fits[1].uncertainty_deg > 2 * fits[0].uncertainty_deg


def test_errors_of_single_pairs_are_found_too():
    true = channels(CHIP, 17, pairs=True)
    found = self_calibrate(echoes_of(CHIP, true), CHIP)
    assert not found.separable
    assert remaining_deg(CHIP, found.factors * true) < 1


def test_without_a_reflector_directions_keep_their_tilt():
    """A tilt of the array is left in place: nothing shows it."""
    tilt = np.exp(1j * linear_phases(CHIP) @ [0.3, 0.8, -0.5])
    true = channels(CHIP, 17)
    plain, tilted = (
        self_calibrate(echoes_of(CHIP, response), CHIP).factors
        for response in (true, true * tilt)
    )
    turned = plain / tilted
    np.testing.assert_allclose(np.angle(turned / turned[0]), 0, atol=0.02)


def test_no_phase_of_the_upper_rows_only_transmitter_is_claimed():
    true = np.ones(12, complex)
    true[8:] *= np.exp(0.6j)  # the elevated one
    factors = self_calibrate(echoes_of(CHIP, true), CHIP).factors
    np.testing.assert_allclose(factors, 1, atol=0.02)


def test_cells_of_several_echoes_lose_their_weight():
    """A seventh of the cells hold one echo, the others two."""
    true = channels(CHIP, 25)
    snapshot = echoes_of(CHIP, true, several=0.85).snapshot.reshape(-1, 12)
    response = channel_response(snapshot, CHIP, separable=False)
    assert remaining_deg(CHIP, true / np.asarray(response)) < 1


def test_a_reflector_fixes_tilt_and_range_bias():
    """Directions of other echoes are then right, and so are ranges."""
    tilt = np.exp(1j * linear_phases(CHIP) @ [0.0, 0.9, -0.7])
    true = channels(CHIP, 20) * tilt
    azimuth, elevation, bias_m = 0.2, 0.1, 0.066
    spot = (3.0 + bias_m) * unit(azimuth, elevation)
    echoes = simulated_echoes(CHIP, true, spot=spot, noise_power=10.0)
    fit = self_calibrate(echoes, CHIP, reflector=(3.0, azimuth, elevation))
    assert fit.range_bias_m == pytest.approx(bias_m, abs=0.01)
    shown = np.angle(fit.factors * true)
    np.testing.assert_allclose(shown, shown.mean(), atol=0.05)
    with pytest.raises(ValueError, match="reflector at 14 m is seen in 0 of 6 frames"):
        self_calibrate(echoes, CHIP, reflector=(14.0, 0.0, 0.0))


def test_a_snapshot_is_the_echo_of_its_cell():
    """Range, velocity and direction of a moving echo, seen through perfect channels."""
    echo = 4.0 * unit([0.3], 0.0), np.array([0.7]), np.array([50.0])
    scene = Scatterers(*map(np.float32, echo))
    cube = simulate_cube(jax.random.key(0), scene, CHIP)
    found = strong_snapshots(cube, Radar(CHIP), count=20)
    assert found.range_m[0] == pytest.approx(4.0, abs=0.02)
    assert found.velocity_mps[0] == pytest.approx(0.7, abs=0.02)
    wave = steering(jnp.array(0.3), jnp.array(0.0), CHIP)
    turn = np.asarray(found.snapshot[0] / wave)
    np.testing.assert_allclose(turn / turn[0], 1, atol=0.05)
    assert not found.snapshot[np.asarray(found.power) == 0].any()


def test_neighbouring_range_bins_are_in_one_half():
    """Copies of an echo in the next bins tell nothing new about the other half."""
    echoes = echoes_of(CHIP, channels(CHIP, 17), frames=2, noise=0.2)
    bins = 4 * np.random.default_rng(0).integers(2, 25, echoes.power.shape) + 0.5

    def uncertainty(heard):
        copies = [
            Snapshots(
                share * echoes.snapshot,
                (bins + further) * CHIP.range_resolution_m,
                echoes.velocity_mps,
                share * echoes.power,
            )
            for further, share in enumerate(heard)
        ]
        joined = jax.tree.map(lambda *parts: np.concatenate(parts, 1), *copies)
        return self_calibrate(joined, CHIP).uncertainty_deg

    assert uncertainty([1, 1, 1]) == pytest.approx(uncertainty([1, 0, 0]), rel=0.02)


MODES = {
    "double precision": lambda: jax.enable_x64(True),
    "no silent broadcasting": lambda: jax.numpy_rank_promotion("raise"),
}
TRUE = channels(CHIP, 20.0, seed=1)
ECHOES = echoes_of(CHIP, TRUE)
REFLECTOR = (3.0, 0.1, 0.0)


def with_reflector():
    """The echoes, of which the first of each frame is the reflector's."""
    echoes = jax.tree.map(np.array, ECHOES)
    echoes.range_m[:, 0], echoes.power[:, 0] = 3.02, 10.0
    return echoes


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_other_precisions_give_the_same_factors(mode):
    expected = self_calibrate(with_reflector(), CHIP, reflector=REFLECTOR)
    snapshot = np.asarray(ECHOES.snapshot, complex).reshape(-1, CHIP.num_virtual)
    with MODES[mode]():
        found = self_calibrate(with_reflector(), CHIP, reflector=REFLECTOR)
        response = channel_response(snapshot, CHIP, separable=True)
    assert found.improves and expected.improves
    np.testing.assert_allclose(found.factors, expected.factors, atol=1e-3)
    double = mode == "double precision"
    assert response.dtype == (np.complex128 if double else np.complex64)


@pytest.mark.parametrize("field", ["snapshot", "range_m", "power"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_echoes_that_are_not_finite_are_left_out(field, value):
    """As if they were not there, at the end of each frame and at its beginning."""
    bad = with_reflector()
    bad.power[2, 3] = bad.power[4, 0] = 0.0
    bad.snapshot[2, 3] = bad.snapshot[4, 0] = 0.0
    expected = self_calibrate(bad, CHIP, reflector=REFLECTOR)
    bad = with_reflector()
    for place in ((2, 3, ...), (4, 0, ...)):
        getattr(bad, field)[place].flat[0] = value  # one antenna is enough
    found = self_calibrate(bad, CHIP, reflector=REFLECTOR)
    assert found.echoes == expected.echoes == 118 and found.improves
    assert 0 < found.uncertainty_deg == expected.uncertainty_deg
    assert found.range_bias_m == pytest.approx(expected.range_bias_m)
    np.testing.assert_array_equal(found.factors, expected.factors)


def test_a_snapshot_with_one_value_that_is_not_finite_changes_no_response():
    snapshot = np.array(ECHOES.snapshot).reshape(-1, CHIP.num_virtual)
    snapshot[7] = 0
    expected = channel_response(snapshot, CHIP, separable=False)
    snapshot[7, 2] = np.nan
    found = channel_response(snapshot, CHIP, separable=False)
    np.testing.assert_array_equal(found, expected)


def test_frames_and_channels_that_cannot_be_calibrated():
    echoes = echoes_of(CHIP, np.ones(12))
    near = echoes._replace(range_m=0 * echoes.range_m)
    with pytest.raises(ValueError, match="120 strong echoes, 0 of .* expected 5"):
        self_calibrate(near, CHIP)
    bad = echoes._replace(snapshot=np.full_like(echoes.snapshot, np.nan))
    with pytest.raises(ValueError, match="0 strong echoes"):
        self_calibrate(bad, CHIP)
    broken = np.ones(12)
    broken[6] = 0.03
    with pytest.raises(ValueError, match="transmitter 1 with receiver 2 is -30 dB"):
        self_calibrate(echoes_of(CHIP, broken, noise=0.001), CHIP)
    pair = RadarSpec.awr1642(tx_positions=((0, 0),), rx_positions=((0, 0), (1, 0)))
    with pytest.raises(ValueError, match="2 virtual antennas: any phases"):
        self_calibrate(echoes_of(pair, np.ones(2)), pair)
