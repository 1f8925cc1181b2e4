"""Crossing chirps: where and how long they are heard, and that excision restores."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    RadarSpec,
    Scatterers,
    detect,
    excise_interference,
    power_map,
    simulate_cube,
)
from jradar.radar.clean.interference import (
    EDGE,
    Interferers,
    crossing_chirps,
    draw_interferers,
    positive_median,
    taper,
)
from tests.directions import unit
from tests.radar.targets import CELLS, SMALL, cloud_of, simulate, sines, target

KEY = jax.random.key(0)
REAL = dataclasses.replace(SMALL, real_samples=True)
KINDS = pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
MIDDLE, LENGTH = 30, 16  # sample of the crossing, and samples in the band
LONG = RadarSpec.awr1843(num_chirps=64)  # 128 samples
POINTS = PointSpec(group_peaks=True, guard=(1, 1), train=(2, 4)).fitted(LONG)
SURE = dataclasses.replace(POINTS, false_alarm_rate=1e-12)


def one_sweep(radar=SMALL, length=LENGTH, middle=MIDDLE):
    """One sweep of amplitude 2 that crosses the first chirp at `middle`."""
    slower = radar.sample_rate_hz**2 / length
    middle_s = radar.adc_start_time_s + middle / radar.sample_rate_hz
    band_hz = 0 if radar.real_samples else radar.sample_rate_hz / 2
    begin_s = -1e-6
    slope = radar.slope_hz_per_s - slower
    start_hz = radar.slope_hz_per_s * middle_s - slope * (middle_s - begin_s) - band_hz
    values = (begin_s, 1.0, 40e-6, start_hz, slope, 0.3, 0.2, 2.0)
    return Interferers(*(jnp.array([value], jnp.float32) for value in values))


def crossing(sweep, radar=SMALL):
    return np.asarray(crossing_chirps(KEY, sweep, radar))


def drawn(radar, *, count=6, amplitude=300.0, seed=1):
    """Chirps of random radars, strong and often by default."""
    key = jax.random.key(seed)
    others = draw_interferers(key, radar, count=count, amplitude=amplitude)
    return np.asarray(crossing_chirps(key, others, radar))


@KINDS
def test_a_crossing_lasts_as_long_as_its_beat_is_in_the_band(radar):
    samples = crossing(one_sweep(radar), radar)
    level = np.abs(samples[0, :, 0]).max(0)
    heard = np.flatnonzero(level > 0.2)
    assert abs(len(heard) - LENGTH) <= 2 and abs(heard.mean() - MIDDLE) <= 1
    assert not samples[1:].any() and not samples[:, :, 1:].any()
    assert level.max() == pytest.approx(2, abs=0.1)


def test_the_beat_sweeps_with_the_difference_of_the_slopes_and_shows_the_direction():
    samples = crossing(one_sweep())[0, :, 0]
    inside = slice(MIDDLE - 6, MIDDLE + 7)
    step = np.angle(samples[0, 1:] * samples[0, :-1].conj())[inside] / (2 * np.pi)
    between = np.arange(SMALL.num_samples - 1)[inside] + 0.5 - MIDDLE
    np.testing.assert_allclose(np.mod(step, 1), 0.5 + between / LENGTH, atol=0.01)
    spacing = SMALL.spacing_wavelengths, SMALL.row_spacing_wavelengths
    turns = np.array(SMALL.rx_positions) * spacing @ sines(0.3, 0.2)
    found = samples[:, MIDDLE] / samples[0, MIDDLE]
    expected = np.exp(2j * np.pi * (turns - turns[0]))
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("length", [8, 0.25], ids=["slow", "faster_than_a_sample"])
def test_the_energy_is_that_of_the_time_in_the_band(length):
    middles = MIDDLE + np.arange(32) / 32
    energies = [np.abs(crossing(one_sweep(SMALL, length, at))) ** 2 for at in middles]
    expected = 2**2 * SMALL.num_rx * length * (1 - EDGE / 2)
    np.testing.assert_allclose(np.sum(energies) / 32, expected, rtol=0.05)


def test_drawn_interferers_cross_many_chirps_in_all_receivers_at_once():
    samples = drawn(SMALL)
    assert np.isfinite(samples).all()
    heard = samples != 0
    assert (heard == heard[:, :1]).all()
    assert 0.2 < heard.any((1, 3)).mean() <= 1
    far = one_sweep()._replace(start_hz=jnp.array([20e9], jnp.float32))
    assert not crossing(far).any()  # of another band


@KINDS
def test_excision_gives_back_a_weak_target(radar):
    strong = simulate(target(3, 10, 0, 0.0, amplitude=500.0), radar)
    clean = strong + simulate(target(4.5, -20, 3, 1.2, amplitude=1.0), radar, seed=1)
    disturbed = np.asarray(clean + drawn(radar))
    excised, found = map(np.asarray, excise_interference(disturbed))

    def snr_db(cube):
        power = np.asarray(power_map(cube))
        column = round(4.5 / radar.range_resolution_m)
        row = 16 + round(1.2 / radar.velocity_resolution_mps)
        near = power[row - 1 : row + 2, column - 1 : column + 2]
        return 10 * np.log10(near.max() / np.median(power))

    assert snr_db(clean) > 15
    assert snr_db(disturbed) < snr_db(clean) - 10
    assert snr_db(excised) > snr_db(clean) - 1
    kept = ~found[:, None].repeat(4, 1)
    np.testing.assert_array_equal(excised[kept], disturbed[kept])


def scene(seed, count, least, most, noise_power):
    """An ADC's whole numbers: echoes of `least` to `most` counts, half of them move."""
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-1, 1, count)
    direction = unit(azimuth, random.uniform(-0.25, 0.25, count))
    reach = 0.95 * LONG.num_range_bins * LONG.range_resolution_m
    distance = random.uniform(0.7, reach, (count, 1))
    velocity = random.uniform(-2, 2, count) * (random.random(count) < 0.5)
    amplitude = np.exp(random.uniform(np.log(least), np.log(most), count))
    echoes = Scatterers(*map(np.float32, (distance * direction, velocity, amplitude)))
    cube = simulate_cube(jax.random.key(seed), echoes, LONG, noise_power=noise_power)
    return rounded(cube)


def rounded(cube):
    return jnp.round(cube.real) + 1j * jnp.round(cube.imag)


def assert_untouched(cube):
    """A frame without interference is returned bit for bit."""
    excised, found = excise_interference(cube)
    assert not found.any()
    np.testing.assert_array_equal(excised, cube)


@pytest.mark.parametrize(
    ("count", "least", "most"), [(60, 20, 300), (20, 20, 3000), (5, 2000, 6000)]
)
@pytest.mark.parametrize("noise_power", [1.0, 10.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_clean_frame_of_many_echoes_stays(count, least, most, noise_power, seed):
    assert_untouched(scene(seed, count, least, most, noise_power))


@KINDS
@pytest.mark.parametrize("velocity", [0.0, 1.37])
def test_a_clean_frame_of_one_strong_echo_is_returned(radar, velocity):
    cube = simulate(target(3.21, 10, 5, velocity, amplitude=1000.0), radar)
    assert_untouched(cube)
    assert_untouched(cube[:, :, :1])  # there is no median over one chirp


@pytest.mark.parametrize("amplitude", [0.0, 1.0, 1000.0])
def test_a_frame_without_noise_is_returned(amplitude):
    """What is left of its echo is float32's rounding, tiny but not alike everywhere."""
    for seed in range(4):
        echo = target(3.2 + 0.03 * seed, 10, 5, 0.37 * seed, amplitude=amplitude)
        assert_untouched(simulate(echo, noise_power=0.0, seed=seed))


@functools.partial(jax.jit, static_argnames="points")
def detected(cube, points=POINTS):
    power = power_map(cube)
    return detect(power, LONG, points=points), jnp.median(power)


@pytest.mark.parametrize(
    ("count", "least", "most", "jammed"),
    [(60, 20, 300, 100.0), (20, 20, 3000, 300.0), (20, 3, 30, 300.0)],
)
def test_detections_of_a_jammed_frame_come_back(count, least, most, jammed):
    """At the floor of the clean frame, of which crossing chirps hide a part."""
    sure = kept = hidden = 0
    for seed in range(4):
        clean = scene(seed, count, least, most, 10.0)
        disturbed = rounded(clean + drawn(LONG, count=3, amplitude=jammed, seed=seed))
        excised, _ = excise_interference(disturbed)
        (wanted, _), (_, floor) = detected(clean, SURE), detected(clean)
        (found, after), (lost, before) = detected(excised), detected(disturbed)
        sure += int(wanted.sum())
        kept += int((wanted & near(found)).sum())
        hidden += int((wanted & ~near(lost)).sum())
        assert after < 1.2 * floor < before / 2
    assert kept >= 0.97 * sure and sure - kept <= hidden / 5


def near(mask):
    """The cells of a mask and their neighbours."""
    for axis in (0, 1):
        mask = mask | np.roll(mask, 1, axis) | np.roll(mask, -1, axis)
    return mask


def test_frames_of_a_batch_do_not_change_each_other():
    clean = simulate(target(3, 10, 0, 0.0, amplitude=500.0))
    frames = jnp.stack([clean, clean + drawn(SMALL), clean + drawn(SMALL, seed=2)])
    alone = jax.tree.map(
        lambda *each: jnp.stack(each), *map(excise_interference, frames)
    )
    for excise in (excise_interference, jax.vmap(excise_interference)):
        excised, found = excise(frames)
        np.testing.assert_array_equal(found, alone[1])
        np.testing.assert_allclose(excised, alone[0], atol=1e-3)
        np.testing.assert_array_equal(excised[0], clean)
    assert not found[0].any() and found[1].any() and found[2].any()


def test_vmap_keeps_the_condition_that_spares_passes():
    frames = jnp.zeros((2, *SMALL.cube_shape), jnp.complex64)
    program = jax.make_jaxpr(jax.vmap(excise_interference))(frames)
    assert " cond[" in str(program)


@pytest.mark.slow
def test_gradients_of_a_batch_are_those_of_its_frames():
    clean = simulate(target(3, 10, 0, 0.0, amplitude=500.0))
    frames = jnp.stack([clean, clean + drawn(SMALL)])

    def total(cube):
        return jnp.abs(excise_interference(cube)[0]).sum()

    alone = jnp.stack([jax.grad(total)(frame) for frame in frames])
    assert jnp.isfinite(alone).all()
    for change in (
        jax.vmap(jax.grad(total)),
        jax.grad(lambda f: jax.vmap(total)(f).sum()),
    ):
        np.testing.assert_allclose(change(frames), alone, atol=1e-3)
    moved = jax.jvp(total, (frames[1],), (frames[1],))[1]
    slope = jnp.vdot(alone[1].conj(), frames[1]).real
    np.testing.assert_allclose(moved, slope, rtol=1e-3)


def test_a_burst_far_below_a_strong_echo_is_found():
    """56 dB below it, and 14 dB over the noise."""
    cube = simulate(target(3, 10, 0, 0.0, amplitude=3000.0))
    cube = cube.at[1, :, 16, 30:34].add(5.0)
    _, found = excise_interference(cube)
    assert found[1, 16, 30:34].all() and not found.at[1, 16].set(False).any()


@pytest.mark.parametrize("count", [1, 2, 7])
def test_the_median_is_that_of_a_sort(count):
    power = np.random.default_rng(count).gamma(0.2, 1e6, (2, 3, count, 5))
    power[0, :, : (count + 1) // 2] = 0  # many are equal
    power = np.float32(power)
    for axes in ((-3, -2), (-2, -1)):
        expected = np.median(power, axes, keepdims=True)
        np.testing.assert_array_equal(
            positive_median(jnp.asarray(power), axes), expected
        )


@KINDS
def test_noise_is_excised_at_the_rate_that_was_asked(radar):
    rate, radar = 1e-3, dataclasses.replace(radar, num_chirps=512)
    silence = simulate(target(5, 0, 0, 0, amplitude=0.0), radar)
    _, found = excise_interference(silence, false_alarm_rate=rate)
    sure = taper(512, 64) > 0.3
    # Each sample that is found takes its two neighbours along.
    np.testing.assert_allclose(np.asarray(found)[:, sure].mean(), 3 * rate, rtol=0.3)


def test_points_are_those_of_the_frame_without_interference():
    clean = simulate(target(5, 20, 5, 1, amplitude=10.0))
    disturbed = clean + drawn(SMALL)
    excising = dataclasses.replace(CELLS, remove_interference=True)
    expected, lost = (cloud_of(cube) for cube in (clean, disturbed))
    cloud = cloud_of(disturbed, points=excising)
    assert cloud.valid[0] and np.linalg.norm(cloud.xyz[0] - expected.xyz[0]) < 0.1
    assert cloud.snr[0] > 0.8 * expected.snr[0] > 8 * lost.snr[0]
    assert CELLS.remove_interference is False
