"""U-Net: sizes, levels where the condition enters, start as nothing, encode once."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import PRESETS, NoiseSpec, UNet, blocks, conditional_denoiser
from tests.diffusion.networks import QUICK, SMALL, apply, build


def test_output_has_the_size_of_the_image_and_sees_the_condition():
    network, params, args = build()
    output = apply(network, params, *args)
    assert output.shape == args[0].shape and jnp.isfinite(output).all()
    other = apply(network, params, args[0], args[1], args[2] + 1.0)
    assert jnp.abs(output - other).max() > 1e-3


def test_a_new_network_predicts_nothing_and_ignores_the_condition():
    network, _, args = build((4, 16), (4, 4), multipliers=(1,), attention_levels=())
    init = jax.jit(network.init, compiler_options=QUICK)
    params = init(jax.random.key(2, impl="rbg"), *args)
    assert not apply(network, params, *args).any()
    trunk = params["params"]["trunk"]
    assert not trunk["enc0_condition"]["kernel"].any()
    assert trunk["stem"]["kernel"].any()


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
    _, other, args = build((16, 64), (16, 16))  # both have a stem of 1 x 4
    assert jax.tree.structure(other) == jax.tree.structure(params)
    assert jax.eval_shape(network.apply, params, *args).shape == (2, 16, 64, 2)


@pytest.mark.parametrize(
    ("preset", "millions"), [("tiny", 6.60), ("small", 8.36), ("paper", 61.94)]
)
def test_presets_fit_the_papers_images(preset, millions):
    network = UNet(**PRESETS[preset])
    shapes = jax.eval_shape(
        network.init,
        jax.random.key(0),
        jnp.zeros((1, 128, 512, 2)),
        jnp.zeros(1),
        jnp.zeros((1, 64, 64, 24)),
    )
    count = sum(p.size for p in jax.tree.leaves(shapes))
    assert count / 1e6 == pytest.approx(millions, abs=0.05)
    assert any("condition" in name for name in shapes["params"]["trunk"])


def test_every_pixel_reaches_the_output_on_its_own():
    # Behind a stem of 4 columns, pixels of one patch still come out apart.
    network, params, (x, c_noise, condition) = build()
    other = x.at[:, 3, 9, 0].add(1.0)
    change = apply(network, params, other, c_noise, condition)
    change = jnp.abs(change - apply(network, params, x, c_noise, condition))[0, 3, :, 0]
    assert change[9] > 2 * jnp.delete(change[8:12], 1).min() > 0


def test_without_the_full_path_an_image_is_drawn_patch_by_patch():
    network, params, (x, c_noise, condition) = build(detail_channels=0)
    trunk = params["params"]["trunk"]
    assert trunk["unfold"]["kernel"].shape == (8, 4 * 2)
    assert not {"output", "refine", "detail"} & trunk.keys()
    # The last map alone, of one column of a patch: that column changes everywhere.
    kernel = trunk["unfold"]["kernel"]
    trunk = {**trunk, "unfold": {**trunk["unfold"], "kernel": kernel.at[:, 4].add(1.0)}}
    change = apply(
        network, {"params": {**params["params"], "trunk": trunk}}, x, c_noise, condition
    )
    change = np.asarray(change - apply(network, params, x, c_noise, condition))
    places = np.argwhere(np.abs(change).max((0, 1)) > 1e-6)
    assert {(column % 4, channel) for column, channel in places.tolist()} == {(2, 0)}


def test_remat_in_bfloat16_is_nearly_the_same_function():
    network, params, args = build()
    expected = apply(network, params, *args)
    half = apply(network.clone(remat=True, dtype=jnp.bfloat16), params, *args)
    assert half.dtype == jnp.float32
    tolerance = 0.1 * float(jnp.abs(expected).max())
    np.testing.assert_allclose(half, expected, atol=tolerance)


def test_one_field_makes_the_network_compute_in_bfloat16():
    network, params, args = build(attention_levels=(0,))
    half = network.clone(dtype="bfloat16")
    assert half == network.clone(dtype=jnp.bfloat16) != network
    assert {leaf.dtype.name for leaf in jax.tree.leaves(params)} == {"float32"}

    def error(network, params):
        return (network.apply(params, *args) ** 2).mean()

    expected = jax.grad(functools.partial(error, network))(params)
    found = jax.grad(functools.partial(error, half))(params)
    for one, other in zip(*map(jax.tree.leaves, (expected, found)), strict=True):
        assert other.dtype == jnp.float32 and jnp.isfinite(other).all()
        size = float(jnp.linalg.norm(one))
        assert jnp.linalg.norm(one - other) <= 0.1 * size + 1e-3
    with pytest.raises(ValueError, match="dtype = 'int8', expected one of"):
        network.clone(dtype="int8")


def test_patches_fold_and_unfold():
    x = jnp.arange(2 * 4 * 8 * 3.0).reshape(2, 4, 8, 3)
    folded = blocks.fold(x, (2, 4))
    assert folded.shape == (2, 2, 2, 24)
    np.testing.assert_array_equal(folded[1, 0, 1, 5 * 3 : 6 * 3], x[1, 1, 5])
    np.testing.assert_array_equal(blocks.unfold(folded, (2, 4)), x)


def test_patches_that_do_not_fill_an_image_are_refused():
    with pytest.raises(ValueError, match="4 x 6 pixels, expected a multiple .* 2 x 4"):
        blocks.fold(jnp.zeros((1, 4, 6, 1)), (2, 4))


def test_unknown_form_is_refused():
    with pytest.raises(ValueError, match="form = 'vit', expected one of"):
        UNet(form="vit")


def test_encoding_once_equals_the_whole_network():
    network, params, (x, _, condition) = build()
    noise = NoiseSpec()
    denoised = jax.jit(
        lambda p: conditional_denoiser(network, p, noise)(condition)(x, 0.7),
        compiler_options=QUICK,
    )(params)
    total = np.sqrt(0.7**2 + 0.5**2)
    output = apply(network, params, x / total, jnp.full(2, np.log(0.7) / 4), condition)
    expected = 0.5**2 / total**2 * x + 0.7 * 0.5 / total * output
    np.testing.assert_allclose(denoised, expected, atol=1e-5)


@pytest.mark.parametrize("at_input", [False, True])
def test_one_condition_serves_a_batch(at_input):
    network, params, (x, _, condition) = build(
        (4, 16), (4, 4), multipliers=(1,), attention_levels=(),
        condition_at_input=at_input,
    )  # fmt: skip
    denoise = jax.jit(
        lambda c: conditional_denoiser(network, params, NoiseSpec())(c)(x, 0.7),
        compiler_options=QUICK,
    )
    one, each = denoise(condition[:1]), denoise(jnp.repeat(condition[:1], len(x), 0))
    assert one.shape == x.shape
    np.testing.assert_allclose(one, each, atol=1e-5)


def test_gradients_are_finite_and_reach_every_parameter():
    network, params, args = build()

    def square(params):
        return (network.apply(params, *args) ** 2).sum()

    gradient = jax.jit(jax.grad(square), compiler_options=QUICK)(params)
    for leaf in jax.tree.leaves(gradient):
        assert jnp.isfinite(leaf).all() and leaf.any()


@pytest.mark.parametrize(
    ("image", "condition", "message"),
    [
        ((9, 32), (8, 8), "image of 9 rows, expected a multiple of 2"),
        ((8, 36), (8, 8), "36 columns, expected a multiple of 8"),
        ((8, 32), (6, 6), "none match, so the condition would be ignored"),
    ],
)
def test_sizes_that_do_not_meet_are_refused(image, condition, message):
    with pytest.raises(ValueError, match=message):
        build(image, condition)
