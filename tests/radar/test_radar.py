"""A radar and its calibration: a pytree whose numbers are traced and mapped."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import Radar, calibrate, radar_points
from tests.radar.targets import CELLS, SMALL, close, simulate, target

CUBE = simulate(target(5, 20, 5, 1))
FACTORS = np.exp(1j * np.linspace(0, 3, 12)).reshape(3, 4)
UNIT = Radar(
    SMALL,
    channels=jnp.asarray(FACTORS, jnp.complex64),
    beat_bins=jnp.zeros((3, 4)),
    leakage=jnp.zeros((3, 4, 32), jnp.complex64),
    range_bias_m=0.2,
)


def test_numbers_are_leaves_and_the_description_is_static():
    leaves, form = jax.tree.flatten(UNIT)
    again = jax.tree.unflatten(form, leaves)
    assert len(leaves) == 4 and again.spec is SMALL
    close(again, UNIT, 0)
    doubled = jax.tree.map(lambda leaf: 2 * leaf, UNIT)
    assert doubled.spec == SMALL and doubled.range_bias_m == 0.4
    assert jax.tree.structure(Radar(SMALL)) == jax.tree.structure(Radar(SMALL))
    assert jax.tree.structure(Radar(SMALL)) != form


def test_units_of_one_radar_share_a_program():
    calibrate(CUBE, Radar(SMALL).with_factors(FACTORS))
    before = calibrate._cache_size()
    calibrate(CUBE, Radar(SMALL).with_factors(2 * FACTORS))
    assert calibrate._cache_size() == before


def test_slopes_of_the_strongest_point_are_those_of_the_formulas():
    """Power grows with the square of the channels, and the bias shortens the range."""

    def power_and_range(scale, bias, cube):
        unit = Radar(SMALL, channels=scale * FACTORS, range_bias_m=bias)
        cloud = radar_points(cube, unit, points=CELLS)
        return jnp.log(cloud.power[0]) + jnp.linalg.norm(cloud.xyz[0])

    slopes = jax.jit(jax.grad(power_and_range, (0, 1, 2)))(1.0, 0.1, CUBE)
    np.testing.assert_allclose(slopes[:2], [2, -1], rtol=1e-3)
    # The range does not depend on the samples' scale, and log power does by 2.
    assert (slopes[2] * CUBE).real.sum() == pytest.approx(2, rel=1e-3)


def test_vmap_over_units_equals_the_loop():
    bias = jnp.array([0.0, 0.7])
    channels = jnp.asarray(np.stack([FACTORS, FACTORS.conj()]), jnp.complex64)
    units = Radar(SMALL, channels=channels, range_bias_m=bias)
    many = jax.vmap(lambda unit: radar_points(CUBE, unit, points=CELLS))(units)
    for i in range(2):
        unit = jax.tree.map(lambda leaf, i=i: leaf[i], units)
        alone = radar_points(CUBE, unit, points=CELLS)
        assert alone.valid.sum() > 8
        close(jax.tree.map(lambda leaf, i=i: leaf[i], many), alone)
    assert jnp.linalg.norm(many.xyz[0, 0] - many.xyz[1, 0]) > 0.5


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


def test_another_number_of_factors_is_refused():
    with pytest.raises(ValueError, match="8 factors, .*needs 12: one for each of 3 tx"):
        Radar(SMALL).with_factors(jnp.ones(8, complex))
