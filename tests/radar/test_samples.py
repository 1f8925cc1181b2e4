"""Cubes of every number type give the spectra of float32; other cubes are refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    Radar,
    calibrate,
    excise_interference,
    power_map,
    radar_points,
    range_doppler,
    static_background,
    subtract_background,
)
from tests.radar.targets import CELLS, SMALL, simulate, target

COUNTS = np.random.default_rng(0).integers(-100, 100, (2, 2, 8, 16, 2))
PAIRS = COUNTS.astype(np.int16)
CUBE = jnp.asarray(COUNTS[..., 0] + 1j * COUNTS[..., 1], jnp.complex64)
REAL = COUNTS[..., 0]


@pytest.mark.parametrize("kind", ["int8", "int16", "int32"])
def test_integer_pairs_are_complex_samples(kind):
    pairs = jnp.asarray(COUNTS, kind)
    for one, other in zip(range_doppler(pairs), range_doppler(CUBE), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(power_map(pairs), power_map(CUBE), rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("kind", ["int16", "float16", "bfloat16"])
def test_real_samples_are_computed_in_float32(kind):
    cube = jnp.asarray(REAL, kind)
    expected = range_doppler(jnp.asarray(REAL, jnp.float32))
    for one, other in zip(range_doppler(cube), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-3)
        assert one.dtype == other.dtype


def test_every_function_of_a_cube_takes_integer_pairs():
    pairs, factors = jnp.asarray(PAIRS), jnp.exp(1j * jnp.arange(4.0))
    background = static_background([PAIRS, PAIRS])
    np.testing.assert_allclose(background, CUBE.mean(-2), rtol=1e-6)
    for function in (
        lambda cube: calibrate(cube, Radar(SMALL).with_factors(factors)),
        lambda cube: subtract_background(cube, background),
        lambda cube: excise_interference(cube)[0],
    ):
        np.testing.assert_allclose(
            function(pairs), function(CUBE), rtol=1e-5, atol=1e-3
        )


def test_points_of_integer_pairs_are_those_of_complex_samples():
    cube = jnp.round(simulate(target(5, 20, 5, 1)))
    pairs = jnp.stack([cube.real, cube.imag], -1).astype(jnp.int16)
    found, expected = (
        radar_points(c, Radar(SMALL), points=CELLS) for c in (pairs, cube)
    )
    assert expected.valid.any()
    pairs = zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-3)


@pytest.mark.usefixtures("as_a_user")
def test_cubes_without_all_axes_and_of_booleans_are_refused():
    for function in (range_doppler, power_map, lambda c: radar_points(c, Radar(SMALL))):
        with pytest.raises(ValueError, match=r"shape \(4, 8, 16\), expected \[..., tx"):
            function(jnp.zeros((4, 8, 16), complex))
    with pytest.raises(ValueError, match="samples are bool, expected ADC samples"):
        power_map(jnp.zeros((1, 1, 8, 16), bool))
