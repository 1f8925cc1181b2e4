"""U-Net: sizes, levels where the condition enters, start as nothing, encode once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import PRESETS, NoiseSpec, UNet, conditional_denoiser
from tests.diffusion.networks import SMALL, apply, build, shaken


@pytest.mark.parametrize(
    ("image", "condition", "stem"),
    [((8, 32), (8, 8), (1, 4)), ((8, 32), (4, 4), (1, 4)), ((16, 64), (8, 8), (2, 8))],
)
def test_output_has_the_size_of_the_image_and_sees_the_condition(
    image, condition, stem
):
    network, params, args = build(image, condition, stem=stem)
    params = shaken(params)
    output = apply(network, params, *args)
    assert output.shape == args[0].shape and jnp.isfinite(output).all()
    other = apply(network, params, args[0], args[1], args[2] + 1.0)
    assert jnp.abs(output - other).max() > 1e-3


def test_a_new_network_predicts_nothing_and_ignores_the_condition():
    network, params, args = build()
    assert not apply(network, params, *args).any()
    entry = params["params"]["trunk"]["enc0_condition"]["kernel"]
    assert not entry.any()


@pytest.mark.parametrize(
    ("condition", "levels"), [((16, 16), {0, 1, 2}), ((8, 8), {1, 2}), ((4, 4), {2})]
)
def test_condition_enters_at_every_level_with_its_grid(condition, levels):
    network = UNet(**SMALL | {"multipliers": (1, 2, 2)})
    shapes = jax.eval_shape(
        network.init,
        jax.random.key(0),
        jnp.zeros((1, 16, 64, 2)),
        jnp.zeros(1),
        jnp.zeros((1, *condition, 3)),
    )
    names = {name for name in shapes["params"]["trunk"] if "condition" in name}
    assert names == {f"enc{level}_condition" for level in levels}


def test_parameters_serve_other_image_sizes():
    network, params, _ = build()
    _, other, args = build((16, 64), (16, 16))
    assert jax.tree.structure(other) == jax.tree.structure(params)
    assert apply(network, shaken(params), *args).shape == (2, 16, 64, 2)


def test_tiny_preset_fits_the_papers_images():
    network = UNet(**PRESETS["tiny"])
    shapes = jax.eval_shape(
        network.init,
        jax.random.key(0),
        jnp.zeros((1, 128, 512, 2)),
        jnp.zeros(1),
        jnp.zeros((1, 64, 64, 24)),
    )
    count = sum(p.size for p in jax.tree.leaves(shapes))
    assert 3e6 < count < 4e6


def test_encoding_once_equals_the_whole_network():
    network, params, (x, _, condition) = build()
    noise = NoiseSpec()
    params = shaken(params)
    denoised = jax.jit(
        lambda p: conditional_denoiser(network, p, noise)(condition)(x, 0.7)
    )(params)
    total = np.sqrt(0.7**2 + 0.5**2)
    output = apply(network, params, x / total, jnp.full(2, np.log(0.7) / 4), condition)
    expected = 0.5**2 / total**2 * x + 0.7 * 0.5 / total * output
    np.testing.assert_allclose(denoised, expected, atol=1e-5)


def test_gradients_are_finite_and_reach_every_parameter():
    network, params, args = build()
    gradient = jax.jit(jax.grad(lambda p: (apply(network, p, *args) ** 2).sum()))(
        shaken(params)
    )
    for leaf in jax.tree.leaves(gradient):
        assert jnp.isfinite(leaf).all() and leaf.any()


@pytest.mark.parametrize(
    ("image", "condition", "message"),
    [
        ((9, 32), (8, 8), "image of 9 rows, expected a multiple of 2"),
        ((8, 36), (8, 8), "36 columns, expected a multiple of 8"),
        ((8, 32), (6, 6), "none is equal, so the condition would be ignored"),
    ],
)
def test_sizes_that_do_not_meet_are_refused(image, condition, message):
    with pytest.raises(ValueError, match=message):
        build(image, condition)
