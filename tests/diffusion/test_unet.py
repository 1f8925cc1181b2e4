"""U-Net: sizes, levels where the condition enters, start as nothing, encode once."""

import collections
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import PRESETS, NoiseSpec, UNet, blocks, conditional_denoiser
from tests.diffusion.networks import SMALL, apply, build, shapes_of


def test_a_new_network_predicts_nothing_and_ignores_the_condition():
    network, _, args = build((4, 16), (4, 4), multipliers=(1,), attention_levels=())
    params = jax.jit(network.init)(jax.random.key(2, impl="rbg"), *args)
    assert not apply(network, params, *args).any()
    trunk = params["params"]["trunk"]
    assert not trunk["enc0_condition"]["kernel"].any()
    # Published weights may put numbers of any size where the noise level enters.
    assert not trunk["detail_affine"]["kernel"].any()
    assert trunk["stem"]["kernel"].any()


@pytest.mark.parametrize(
    ("condition", "levels"), [((16, 16), {0, 1, 2}), ((8, 8), {1, 2}), ((4, 4), {2})]
)
def test_condition_enters_at_every_level_with_its_grid(condition, levels):
    network = UNet(**SMALL | {"multipliers": (1, 2, 2)})
    trunk = shapes_of(network, (16, 64, 2), (*condition, 3))["params"]["trunk"]
    names = {name for name in trunk if "condition" in name}
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
    shapes = shapes_of(UNet(**PRESETS[preset]), (128, 512, 2), (64, 64, 24))
    count = sum(p.size for p in jax.tree.leaves(shapes))
    assert count / 1e6 == pytest.approx(millions, abs=0.05)
    assert any("condition" in name for name in shapes["params"]["trunk"])


def test_every_pixel_reaches_the_output_on_its_own():
    # Behind a stem of 4 columns, pixels of one patch still come out apart.
    network, params, (x, *rest) = build()
    both = (np.asarray(apply(network, params, image, *rest))
            for image in (x, x.at[:, 3, 9, 0].add(1.0)))  # fmt: skip
    change = np.abs(np.subtract(*both))[0, 3, :, 0]
    assert change[9] > 2 * np.delete(change[8:12], 1).min() > 0


def test_without_the_full_path_an_image_is_drawn_patch_by_patch():
    network, params, args = build(detail_channels=0)
    trunk = params["params"]["trunk"]
    assert trunk["unfold"]["kernel"].shape == (8, 4 * 2)
    assert not {"output", "refine", "detail"} & trunk.keys()
    # The last map alone, of one column of a patch: that column changes everywhere.
    kernel = trunk["unfold"]["kernel"]
    other = {**trunk, "unfold": {**trunk["unfold"], "kernel": kernel.at[:, 4].add(1)}}
    both = (params, {"params": {**params["params"], "trunk": other}})
    found = np.subtract(*(np.asarray(apply(network, p, *args)) for p in both))
    places = np.argwhere(np.abs(found).max((0, 1)) > 1e-6)
    assert {(column % 4, channel) for column, channel in places.tolist()} == {(2, 0)}


@pytest.mark.slow
def test_remat_in_bfloat16_is_nearly_the_same_function():
    network, params, args = build()
    expected = apply(network, params, *args)
    half = apply(network.clone(remat=True, dtype=jnp.bfloat16), params, *args)
    assert half.dtype == jnp.float32
    tolerance = 0.1 * float(jnp.abs(expected).max())
    np.testing.assert_allclose(half, expected, atol=tolerance)


def test_one_field_makes_the_network_compute_in_bfloat16():
    network, params, args = build(attention_levels=())
    half = network.clone(dtype="bfloat16")
    assert half == network.clone(dtype=jnp.bfloat16) != network
    slopes = jax.eval_shape(jax.grad(lambda p: half.apply(p, *args).sum()), params)
    kinds = {leaf.dtype.name for leaf in jax.tree.leaves((params, slopes))}
    assert kinds == {"float32"}
    text = str(jax.make_jaxpr(half.apply)(params, *args))
    product = r":(\w+)\[\S*\] = (?:conv_general_dilated|dot_general)\["
    kinds = collections.Counter(re.findall(product, text))
    assert kinds["bf16"] > 20 and kinds["f32"] == 1  # of the one softmax
    with pytest.raises(ValueError, match="dtype = 'int8', expected one of"):
        network.clone(dtype="int8")


def test_patches_fold_and_unfold():
    x = jnp.arange(2 * 4 * 8 * 3.0).reshape(2, 4, 8, 3)
    folded = blocks.fold(x, (2, 4))
    assert folded.shape == (2, 2, 2, 24)
    np.testing.assert_array_equal(folded[1, 0, 1, 5 * 3 : 6 * 3], x[1, 1, 5])
    np.testing.assert_array_equal(blocks.unfold(folded, (2, 4)), x)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="4 x 6 pixels, expected a multiple .* 2 x 4"):
        blocks.fold(jnp.zeros((1, 4, 6, 1)), (2, 4))
    with pytest.raises(ValueError, match="form = 'vit', expected one of"):
        UNet(form="vit")


def test_encoding_once_equals_the_whole_network():
    network, params, (x, _, condition) = build()
    denoised = jax.jit(
        lambda p: conditional_denoiser(network, p, NoiseSpec())(condition)(x, 0.7)
    )(params)
    total = np.sqrt(0.7**2 + 0.5**2)
    output = apply(network, params, x / total, jnp.full(2, np.log(0.7) / 4), condition)
    expected = 0.5**2 / total**2 * x + 0.7 * 0.5 / total * output
    np.testing.assert_allclose(denoised, expected, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("at_input", [False, True])
def test_one_condition_serves_a_batch(at_input):
    network, params, (x, _, condition) = build(
        (4, 16), (4, 4), multipliers=(1,), attention_levels=(),
        condition_at_input=at_input,
    )  # fmt: skip
    denoise = jax.jit(
        lambda c: conditional_denoiser(network, params, NoiseSpec())(c)(x, 0.7)
    )
    one, each = denoise(condition[:1]), denoise(jnp.repeat(condition[:1], len(x), 0))
    assert one.shape == x.shape
    np.testing.assert_allclose(one, each, atol=1e-5)


@pytest.mark.slow
def test_gradients_are_finite_and_reach_every_parameter():
    network, params, args = build()

    def square(params):
        return (network.apply(params, *args) ** 2).sum()

    for leaf in map(np.asarray, jax.tree.leaves(jax.jit(jax.grad(square))(params))):
        assert np.isfinite(leaf).all() and leaf.any()


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
