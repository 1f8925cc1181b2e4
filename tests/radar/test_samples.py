"""Cubes of every number type give the spectra of float32; other cubes are refused."""

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
from tests.radar.targets import SMALL, close, cloud_of, simulate, target

COUNTS = np.random.default_rng(0).integers(-100, 100, (2, 2, 8, 16, 2))
PAIRS = COUNTS.astype(np.int16)
CUBE = jnp.asarray(COUNTS @ [1, 1j], jnp.complex64)


@pytest.mark.parametrize("kind", ["int8", "int32"])
def test_integer_pairs_are_complex_samples(kind):
    pairs = jnp.asarray(COUNTS, kind)
    close(
        (*range_doppler(pairs), power_map(pairs)),
        (*range_doppler(CUBE), power_map(CUBE)),
    )


@pytest.mark.parametrize("kind", ["int16", "bfloat16"])
def test_real_samples_are_computed_in_float32(kind):
    cube = jnp.asarray(COUNTS[..., 0], kind)
    found, expected = map(range_doppler, (cube, cube.astype(jnp.float32)))
    close(found, expected)
    assert [part.dtype for part in found] == [part.dtype for part in expected]


def test_every_function_of_a_cube_takes_integer_pairs():
    unit = Radar(SMALL).with_factors(np.exp(1j * np.arange(12)))
    background = static_background([PAIRS, PAIRS])
    np.testing.assert_allclose(background, CUBE.mean(-2), rtol=1e-6)
    wide = np.resize(COUNTS, (3, 4, 8, 16, 2))
    close(
        calibrate(jnp.asarray(wide, jnp.int16), unit),
        calibrate(jnp.asarray(wide @ [1, 1j], jnp.complex64), unit),
    )
    for function in (
        lambda cube: subtract_background(cube, background),
        lambda cube: excise_interference(cube)[0],
    ):
        close(function(jnp.asarray(PAIRS)), function(CUBE))


def test_points_of_integer_pairs_are_those_of_complex_samples():
    cube = np.round(simulate(target(5, 20, 5, 1)))
    pairs = np.stack([cube.real, cube.imag], -1).astype(np.int16)
    found, expected = (cloud_of(c) for c in (pairs, cube))
    assert expected.valid.any()
    close(found, expected)


@pytest.mark.usefixtures("as_a_user")
def test_cubes_without_all_axes_and_of_booleans_are_refused():
    for function in (range_doppler, power_map, lambda c: radar_points(c, Radar(SMALL))):
        with pytest.raises(ValueError, match=r"shape \(4, 8, 16\), expected \[..., tx"):
            function(jnp.zeros((4, 8, 16), complex))
    with pytest.raises(ValueError, match="samples are bool, expected ADC samples"):
        power_map(jnp.zeros((1, 1, 8, 16), bool))
