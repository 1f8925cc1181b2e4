"""A radar and its calibration: documented chains, a pytree, number types, errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    calibrate,
    compensate_tdm,
    excise_interference,
    power_map,
    radar_points,
    range_doppler,
    static_background,
    subtract_background,
    subtract_leakage,
)
from tests.radar.targets import CASCADE, CELLS, SMALL, close, noise, simulate, target

SHORT = RadarSpec.awr1843(num_chirps=8, num_samples=32)
COUNTS = np.random.default_rng(0).integers(-100, 100, (3, 4, 8, 32, 2))
CUBE, CHANNELS = COUNTS @ [1, 1j], noise(3, 4, seed=1)
BINS = np.random.default_rng(0).uniform(-1, 1, size=(3, 4))
COUPLING = 100 * noise(3, 4, 16, seed=2)
EVERY = PointSpec(false_alarm_rate=1.0).fitted(SHORT)
FRAME = simulate(target(5, 20, 5, 1))
FACTORS = np.exp(1j * np.linspace(0, 3, 12)).reshape(3, 4)
UNIT = Radar(
    SMALL,
    channels=jnp.asarray(FACTORS, jnp.complex64),
    beat_bins=jnp.zeros((3, 4)),
    leakage=jnp.zeros((3, 4, 32), jnp.complex64),
    range_bias_m=0.2,
)


def near(actual, expected):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, atol=1e-5 * scale)


def test_channels_and_beat_frequencies_follow_the_documented_sums():
    """One antenna pair and one sample at a time."""
    expected = np.empty(CUBE.shape, complex)
    for tx, rx, n in np.ndindex(3, 4, 32):
        turn = np.exp(-2j * np.pi * BINS[tx, rx] * n / 32)
        expected[tx, rx, :, n] = CUBE[tx, rx, :, n] * turn * CHANNELS[tx, rx]
    unit = Radar(SHORT, channels=jnp.array(CHANNELS), beat_bins=jnp.array(BINS))
    near(calibrate(jnp.array(CUBE), unit), expected)


@pytest.mark.parametrize("doppler_bin", [0.0, 3.0, -2.6])
def test_a_transmitters_lead_is_its_place_in_the_firing_order(doppler_bin):
    wave = noise(CASCADE.num_virtual)
    found = compensate_tdm(jnp.array(wave), jnp.float32(doppler_bin), CASCADE)
    for place, tx in enumerate(CASCADE.tx_firing_order):
        turn = np.exp(-2j * np.pi * doppler_bin * place / 12 / CASCADE.num_chirps)
        antennas = slice(16 * tx, 16 * tx + 16)
        near(found[antennas], wave[antennas] * turn)


@pytest.mark.parametrize("doppler_window", ["none", "hann"])
def test_coupling_follows_the_documented_chain(doppler_window):
    """Blackman, FFT, bins 1 .. N/2 less the coupling; then the Doppler FFT."""
    x, y = (2 * np.pi * np.arange(n) / n for n in (32, 8))
    expected = np.fft.fft(CUBE * (0.42 - 0.5 * np.cos(x) + 0.08 * np.cos(2 * x)))
    expected[..., 1:17] -= COUPLING[:, :, None]
    weight = {"none": np.ones(8), "hann": 1 - np.cos(y)}[doppler_window] / 8
    expected = np.fft.fft(expected * weight[:, None], axis=-2)
    expected = np.fft.fftshift(expected, axes=-2).reshape(12, 8, 32)
    window = {"doppler_window": doppler_window}
    spectrum, _ = range_doppler(jnp.array(CUBE), range_window="blackman", **window)
    actual = subtract_leakage(spectrum, jnp.array(COUPLING), **window)
    near(0.42 * 32 * actual, expected)


def test_numbers_are_leaves_and_the_description_is_static():
    leaves, form = jax.tree.flatten(UNIT)
    again = jax.tree.unflatten(form, leaves)
    assert len(leaves) == 4 and again.spec is SMALL
    close(again, UNIT, 0)
    doubled = jax.tree.map(lambda leaf: 2 * leaf, UNIT)
    assert doubled.spec == SMALL and doubled.range_bias_m == 0.4
    assert jax.tree.structure(Radar(SMALL)) == jax.tree.structure(Radar(SMALL))
    assert jax.tree.structure(Radar(SMALL)) != form
    calibrate(FRAME, Radar(SMALL).with_factors(FACTORS))
    before = calibrate._cache_size()
    calibrate(FRAME, Radar(SMALL).with_factors(2 * FACTORS))  # by the same program
    assert calibrate._cache_size() == before


@pytest.mark.slow
def test_slopes_of_the_strongest_point_are_those_of_the_formulas():
    """Power grows with the square of the channels, and the bias shortens the range."""

    def power_and_range(scale, bias, cube):
        unit = Radar(SMALL, channels=scale * FACTORS, range_bias_m=bias)
        cloud = radar_points(cube, unit, points=CELLS)
        return jnp.log(cloud.power[0]) + jnp.linalg.norm(cloud.xyz[0])

    slopes = jax.jit(jax.grad(power_and_range, (0, 1, 2)))(1.0, 0.1, FRAME)
    np.testing.assert_allclose(slopes[:2], [2, -1], rtol=1e-3)
    # The range does not depend on the samples' scale, and log power does by 2.
    assert (slopes[2] * FRAME).real.sum() == pytest.approx(2, rel=1e-3)


@pytest.mark.slow
def test_vmap_over_units_equals_the_loop():
    bias = jnp.array([0.0, 0.7])
    channels = jnp.asarray(np.stack([FACTORS, FACTORS.conj()]), jnp.complex64)
    units = Radar(SMALL, channels=channels, range_bias_m=bias)
    many = jax.vmap(lambda unit: radar_points(FRAME, unit, points=CELLS))(units)
    for i in range(2):
        unit = jax.tree.map(lambda leaf, i=i: leaf[i], units)
        alone = radar_points(FRAME, unit, points=CELLS)
        assert alone.valid.sum() > 8
        close(jax.tree.map(lambda leaf, i=i: leaf[i], many), alone)
    assert jnp.linalg.norm(many.xyz[0, 0] - many.xyz[1, 0]) > 0.5


@pytest.mark.slow
def test_every_function_of_a_cube_takes_integer_pairs():
    unit = Radar(SHORT).with_factors(np.exp(1j * np.arange(12)))
    pairs, cube = COUNTS.astype(np.int16), jnp.asarray(CUBE, jnp.complex64)
    for kind in ("int8", "int32"):
        close(power_map(COUNTS.astype(kind)), power_map(cube))
    background = static_background([pairs, pairs])
    np.testing.assert_allclose(background, cube.mean(-2), rtol=1e-6)
    for function in (
        range_doppler,
        power_map,
        lambda cube: calibrate(cube, unit),
        lambda cube: subtract_background(cube, background),
        lambda cube: excise_interference(cube)[0],
        lambda cube: radar_points(cube, unit, points=EVERY),
    ):
        close(function(pairs), function(cube))


@pytest.mark.parametrize("kind", ["int16", "bfloat16"])
def test_real_samples_are_computed_in_float32(kind):
    cube = jnp.asarray(COUNTS[..., 0], kind)
    found, expected = map(range_doppler, (cube, cube.astype(jnp.float32)))
    close(found, expected)
    assert [part.dtype for part in found] == [part.dtype for part in expected]


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"channels": np.ones((2, 4))}, r"channels has shape \(2, 4\), awr1843 needs"),
        ({"channels": np.ones(12)}, r"channels has shape \(12,\), .* needs \(3, 4\)"),
        ({"beat_bins": np.ones((4, 3))}, r"beat_bins has shape \(4, 3\), awr1843"),
        ({"leakage": np.ones((3, 4, 31))}, r"leakage has shape \(3, 4, 31\), awr1843"),
        ({"spec": "awr1843"}, "Radar of str, expected a RadarSpec"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_parts_of_another_array_are_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        Radar(**({"spec": SMALL} | parts))


SPECTRUM, THREE_AXES = (jnp.zeros(n, complex) for n in ((12, 8, 32), (4, 8, 16)))


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (Radar(SMALL).with_factors, [np.ones(8)], "8 factors, .*needs 12: one for .*"),
        (subtract_leakage, [SPECTRUM, COUPLING[..., 1:]], "3 tx x 4 rx x 15 range bin"),
        (subtract_leakage, [SPECTRUM, COUPLING[1:]], "2 tx x 4 rx x 16"),
        (compensate_tdm, [np.ones((5, 24)), np.ones(5), SHORT], "24 values per snapsh"),
        (range_doppler, [THREE_AXES], r"shape \(4, 8, 16\), expected \[..., tx"),
        (power_map, [THREE_AXES], r"shape \(4, 8, 16\), expected \[..., tx"),
        (radar_points, [THREE_AXES, UNIT], r"shape \(4, 8, 16\), expected \[..., tx"),
        (power_map, [np.zeros((1, 1, 8, 16), bool)], "bool, expected ADC samples"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_sizes_that_do_not_fit_are_refused(function, arguments, message):
    with pytest.raises(ValueError, match=message):
        function(*arguments)
