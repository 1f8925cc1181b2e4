"""Evidence: smeared points, and anchors where these are."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import diffusion
from jradar.diffusion.evidence import smear
from jradar.diffusion.network import network_from_fields
from jradar.range_code import decode_range
from tests.diffusion.networks import apply, random_params

VIEW = {"azimuth": (-1.0, 1.0), "elevation": (-0.4, 0.4), "max_range_m": 8.0}
# Smeared by 8 m / 60 at 5 m, of which a pixel is 0.33 by 0.42 m.
SEEN = VIEW | {"azimuth": (-2 / 3, 2 / 3), "elevation": (-0.8 / 3, 0.8 / 3)}
WIDE_M, ROW_M, COLUMN_M = 8 / 60, 5.0 * 0.2 / 3, 5.0 * 0.25 / 3
FIELDS = {"channels": 8, "multipliers": (1,), "attention_levels": (), "blocks": 1}
FIELDS |= {"stem": (4, 8), "condition_stem": (2, 2), "outputs": 14}
NOISE = diffusion.NoiseSpec(prediction=diffusion.PREDICTIONS["mixture"])
IMAGE, CONDITION, SLICES = (16, 64), (8, 16), 4
NETWORK = diffusion.build_network(kind="evidence", anchors=4, **FIELDS, **VIEW)
ARGS = (jnp.zeros((1, *IMAGE, 2)), jnp.zeros(1), jnp.zeros((1, *CONDITION, 12)))


def one_point(row=4, column=8, part=2, offset=0.5, power=0.7):
    """A condition with one point; the middle of slice 2 is at 5 m."""
    condition = np.zeros((1, *CONDITION, 3, SLICES), np.float32)
    condition[0, row, column, :, part] = (1.0, offset, power)
    return jnp.asarray(condition.reshape(1, *CONDITION, 12))


@pytest.fixture(scope="module")
def first_params():
    return jax.jit(NETWORK.init)(jax.random.key(0), *ARGS)


def test_a_point_is_smeared_by_a_sixtieth_of_the_view_at_its_range():
    parts = np.split(np.asarray(smear(one_point(), **SEEN))[0], 3, -1)
    count, place, power = (part[..., 2] for part in parts)
    row, column = np.ogrid[:8, :16]
    away_m = np.hypot(ROW_M * (row - 4), COLUMN_M * (column - 8))
    expected = np.exp(-((away_m / WIDE_M) ** 2) / 2)
    np.testing.assert_allclose(count, expected, atol=1e-5)
    reached = count > 1e-3
    assert 3 < reached.sum() < 20
    np.testing.assert_allclose(place[reached], 0.5, rtol=1e-4)
    np.testing.assert_allclose(power[reached], 0.7, rtol=1e-4)
    assert not np.delete(parts[0], 2, -1).any()  # of the other slices


def test_points_in_one_reach_give_their_mean():
    both = one_point(column=7, offset=-0.5, power=0.1) + one_point(column=8)
    count, place, power = np.split(np.asarray(smear(both, **SEEN))[0], 3, -1)
    near = np.exp(-((COLUMN_M / WIDE_M) ** 2) / 2)
    assert count[4, 8, 2] == pytest.approx(1 + near, rel=1e-5)
    assert place[4, 8, 2] == pytest.approx((0.5 - 0.5 * near) / (1 + near), rel=1e-4)


@jax.jit
def mixture_at_first(params, condition):
    denoise = diffusion.conditional_denoiser(NETWORK, params, NOISE)(condition)
    return diffusion.range_mixture(denoise, (1, *IMAGE, 2), noise=NOISE)


def test_the_first_anchor_is_at_the_point_and_outweighs_the_others(first_params):
    mixture = mixture_at_first(first_params, one_point())
    assert mixture.centre.shape == (1, *IMAGE, 8)
    weight, centre = np.asarray(mixture.weight)[0], mixture.centre[0]
    range_m = np.asarray(decode_range(centre, max_range_m=8.0))
    there = np.s_[8:10, 32:36]  # the pixels of the point's own coarse pixel
    np.testing.assert_allclose(range_m[there][..., 4], 5.5, atol=1e-3)
    assert (weight[there][..., 4] > 5 * weight[there][..., 5:].max(-1)).all()
    elsewhere = np.sort(range_m[0, 0, 4:])
    np.testing.assert_allclose(elsewhere, [1.0, 3.0, 5.0, 7.0], atol=1e-3)
    np.testing.assert_allclose(weight.sum(-1), 1.0, rtol=1e-5)


def test_without_a_correction_the_other_components_are_those_of_the_unet(
    first_params, tmp_path
):
    plain = diffusion.build_network(**FIELDS)
    known = random_params(plain, *ARGS)
    path = tmp_path / "plain.safetensors"
    diffusion.write_params(path, known)
    params, report = diffusion.load_pretrained(path, NETWORK, first_params)
    assert {name.split("/")[1] for name in report.new} == {"evidence"}
    condition = jax.random.normal(jax.random.key(1), ARGS[2].shape)
    expected = apply(plain, known, *ARGS[:2], condition)
    found = apply(NETWORK, params, *ARGS[:2], condition)
    np.testing.assert_allclose(found[..., :14], expected, atol=0.01)  # of about 1


def test_weights_fit_a_condition_with_more_channels_and_answer_the_same(tmp_path):
    known = random_params(NETWORK, *ARGS)
    path = tmp_path / "known.safetensors"
    diffusion.write_params(path, known, dtype=np.float32)
    wider = diffusion.build_network(
        kind="evidence", anchors=4, parts=5, **FIELDS, **VIEW
    )
    condition = jnp.abs(jax.random.normal(jax.random.key(1), ARGS[2].shape))
    more = jnp.concatenate([condition, jnp.ones((1, *CONDITION, 8))], -1)
    first = jax.jit(wider.init)(jax.random.key(0), *ARGS[:2], more)
    params, _ = diffusion.load_pretrained(path, wider, first)
    expected = apply(NETWORK, known, *ARGS[:2], condition)
    found = apply(wider, params, *ARGS[:2], more)
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_gradients_are_finite_without_a_point_and_with_one(first_params):
    @jax.jit
    @jax.grad
    def slope(params, condition):
        mixture = mixture_at_first(params, condition)
        return sum(part.mean() for part in mixture) + mixture.centre[..., 4].mean()

    for condition in (0 * one_point(), one_point()):
        found = jax.tree.leaves(slope(first_params, condition))
        assert all(np.isfinite(leaf).all() for leaf in found)
        assert any(np.any(leaf) for leaf in found)


def test_its_fields_come_back_from_a_file():
    assert network_from_fields(diffusion.network_fields(NETWORK)) == NETWORK
