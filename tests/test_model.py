"""The three functions from a cube to a dense cloud."""

import dataclasses

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import PREDICTIONS, SOLVERS, NoiseSpec, UNet
from jradar.model import (
    Card,
    Model,
    compiling,
    condition,
    draw,
    enhance,
    enhance_points,
)
from jradar.radar import Radar, RadarSpec, Scatterers, radar_points, simulate_cube
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    ImageSpec,
    encode_target,
    project,
)
from jradar.types import PointCloud
from tests.models import tiny_model

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
UNIT = Radar(RADAR)
FINE = ImageSpec(8, 32)
LIDAR = 4.0 + np.sin(np.arange(8 * 32.0)).reshape(FINE.shape)


@pytest.fixture(scope="module")
def model():
    return tiny_model(fine=ImageSpec(8, 32, azimuth=(-1.0, 0.5)))


@pytest.fixture(scope="module")
def quick():
    """A model that answers in one evaluation, with a point in every pixel."""
    return tiny_model(method="regression", validity_threshold=-1e6)


def echoes(key):
    """A cube of 20 targets in front of the radar."""
    place = jax.random.uniform(key, (20, 3), minval=-1.0, maxval=1.0)
    targets = Scatterers(
        place + jnp.array([3.0, 0.0, 0.0]), jnp.zeros(20), jnp.full(20, 50.0)
    )
    return simulate_cube(key, targets, RADAR, noise_power=1.0)


class Oracle(nn.Module):
    """A network that answers with stored images, whatever it is shown."""

    images: tuple
    sigma_data: float = 0.5

    def __call__(self, x, c_noise, condition):
        """Encode and decode."""
        return self.decode(x, c_noise, self.encode(condition))

    def encode(self, condition):
        """Return the condition as it is."""
        return condition

    def decode(self, x, c_noise, features):
        """Return the stored images."""
        target = encode_target(jnp.asarray(self.images), FINE) / self.sigma_data
        return jnp.broadcast_to(target, x.shape)


def oracle(*images):
    """A model whose clean images are `images`, one for each draw."""
    stored = tuple(tuple(map(tuple, image.tolist())) for image in images)
    spec = dataclasses.replace(
        tiny_model().spec,
        network=Oracle(stored),
        noise=NoiseSpec(prediction=PREDICTIONS["clean"]),
        codec="log",
    )
    return Model({}, spec)


def test_the_networks_image_becomes_the_cloud():
    cloud = enhance(
        jax.random.key(1), echoes(jax.random.key(0)), UNIT, oracle(LIDAR), draws=1
    )
    assert cloud.xyz.shape == (8 * 32, 3)
    np.testing.assert_allclose(project(cloud, FINE), LIDAR, atol=1e-4)


def test_several_draws_give_what_they_agree_on():
    near, far = np.full(FINE.shape, 3.0), np.full(FINE.shape, 6.0)
    model = oracle(near, far, far + 0.1, np.zeros(FINE.shape))
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    agreed = draw(key, image, model, draws=4, steps=2)
    np.testing.assert_allclose(agreed.range_m, 6.05, atol=1e-4)
    np.testing.assert_allclose(agreed.confidence, 0.5)
    none = draw(key, image, model, draws=4, steps=2, least_confidence=0.6)
    assert not none.range_m.any()
    with pytest.raises(ValueError, match="draws=0, expected 1 or more"):
        draw(key, image, model, draws=0)


@pytest.mark.parametrize("steps", [2, 3])
def test_one_draw_of_few_steps_is_what_ipndm_gives(model, steps):
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    options = {"draws": 1, "steps": steps}
    quick = draw(key, image, model, solver=SOLVERS["ipndm3"], **options).range_m
    found = draw(key, image, model, **options).range_m
    assert quick.any()
    np.testing.assert_allclose(found, quick, rtol=1e-5)


def test_a_regression_model_answers_once_and_draws_no_samples(model):
    spec = dataclasses.replace(oracle(LIDAR).spec, method="regression")
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    estimate = draw(key, image, Model({}, spec))
    np.testing.assert_allclose(estimate.range_m, LIDAR, atol=1e-4)
    assert estimate.confidence is None
    with pytest.raises(ValueError, match="draws, steps: a model trained by regression"):
        draw(key, image, Model({}, spec), draws=1, steps=3)
    with pytest.raises(ValueError, match="method = 'magic', expected one of"):
        dataclasses.replace(model.spec, method="magic")


def test_a_frame_without_echoes_gives_no_points(quick):
    image = jnp.zeros((8, 8, 12))
    assert not draw(jax.random.key(0), image, quick).range_m.any()
    assert draw(jax.random.key(0), image.at[3, 4, 5].set(1.0), quick).range_m.all()
    cube = jnp.zeros(RADAR.cube_shape, complex)
    assert not enhance(jax.random.key(0), cube, UNIT, quick).valid.any()
    drawn = {"draws": 2, "steps": 2}
    assert not enhance(
        jax.random.key(0), cube, UNIT, oracle(LIDAR), **drawn
    ).valid.any()


def test_vmap_over_frames_equals_the_loop(quick):
    keys = jax.random.split(jax.random.key(0), 2)
    cubes = jnp.stack([echoes(key) for key in keys])
    batch = jax.vmap(enhance, (0, 0, None, None))(keys, cubes, UNIT, quick)
    assert batch.valid.any()
    for i in range(2):
        alone = enhance(keys[i], cubes[i], UNIT, quick)
        np.testing.assert_allclose(batch.xyz[i], alone.xyz, atol=1e-3)


def test_a_radar_of_another_slope_moves_a_target_in_proportion():
    """What a cube without its radar would hide: the slope decides the range."""
    target = Scatterers(jnp.array([[5.0, 0.0, 0.0]]), jnp.zeros(1), jnp.full(1, 50.0))
    cube = simulate_cube(jax.random.key(0), target, RADAR, noise_power=1.0)
    steep = dataclasses.replace(RADAR, slope_hz_per_s=2 * RADAR.slope_hz_per_s)
    found = [
        float(radar_points(cube, Radar(radar)).xyz[0, 0]) for radar in (RADAR, steep)
    ]
    np.testing.assert_allclose(found, [5.0, 2.5], atol=0.05)


def test_points_of_any_origin_are_enhanced_as_those_of_the_cube(quick):
    key, cube = jax.random.key(1), echoes(jax.random.key(0))
    points = radar_points(cube, UNIT, points=quick.spec.points.fitted(RADAR))
    expected = enhance(key, cube, UNIT, quick)
    found = enhance_points(key, points, quick)
    np.testing.assert_array_equal(found.xyz, expected.xyz)
    np.testing.assert_array_equal(found.velocity, expected.velocity)
    bare = PointCloud(points.xyz, points.valid)
    assert enhance_points(key, bare, quick).velocity is None


def test_models_of_other_cards_and_tables_share_programs_and_map_together(quick):
    other = dataclasses.replace(
        quick,
        card=Card("another purpose", 9),
        confidence=ConfidenceTable.of((0.0, 1.0), least=0.2),
    )
    other = dataclasses.replace(
        other, confidence=other.confidence._replace(frequencies=IDENTITY.frequencies)
    )
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    draw(key, image, quick)
    before = draw._cache_size()
    draw(key, image, other)
    assert draw._cache_size() == before
    mean = jax.tree.map(lambda a, b: (a + b) / 2, quick, other)
    assert mean.card == quick.card != other.card
    assert float(mean.confidence.least) == pytest.approx((0.375 + 0.2) / 2)


def test_what_a_user_holds_is_one_line(model):
    for held in (model, UNIT.with_factors(jnp.ones(12)), model.card.radar):
        assert len(repr(held).splitlines()) == 1
    assert len(repr(model)) < 200 and "million parameters" in repr(model)
    assert repr(UNIT).endswith("not calibrated)") and len(repr(UNIT)) < 200


def test_a_gradient_reaches_the_parameters(quick):
    image = jax.random.normal(jax.random.key(0), (8, 8, 12))

    def mean_range(model):
        return draw(jax.random.key(1), image, model).range_m.mean()

    slope = jax.grad(mean_range)(quick)
    assert isinstance(slope, Model) and slope.spec == quick.spec
    sizes = [float(jnp.abs(leaf).sum()) for leaf in jax.tree.leaves(slope.params)]
    assert np.isfinite(sizes).all() and sum(sizes) > 0


@pytest.mark.usefixtures("as_a_user")
def test_a_condition_of_another_size_is_refused(model):
    key = jax.random.key(0)
    for shape in ((8, 8, 9), (16, 16, 12), (2, 8, 8, 12)):
        with pytest.raises(ValueError, match=r"model needs .* = \(8, 8, 12\)"):
            draw(key, jnp.zeros(shape), model, draws=1, steps=1)


def test_a_condition_that_skips_a_level_of_the_network_is_refused():
    """Its grids 8 x 8 and 4 x 4 met two levels; those of 16 x 16 would meet one."""
    two = UNet(
        channels=8, multipliers=(1, 1), blocks=1, attention_levels=(), stem=(1, 4)
    )
    model = tiny_model(network=two)
    larger = dataclasses.replace(
        model.spec,
        coarse=ImageSpec(16, 16),
    )
    key, cube = jax.random.key(0), jnp.zeros(RADAR.cube_shape, complex)
    with pytest.raises(ValueError, match=r"none is .* where it entered in training"):
        enhance(key, cube, UNIT, Model(model.params, larger), draws=1, steps=1)


def test_another_radars_cube_is_refused(model):
    cube = jnp.zeros((2, 4, 16, 64), jnp.complex64)
    with pytest.raises(ValueError, match=r"cube has shape \(2, 4, 16, 64\)"):
        condition(cube, UNIT, model)
    other = Radar(RadarSpec.awr1642(num_chirps=16, num_samples=64))
    assert condition(cube, other, model).shape == (8, 8, 12)


def test_compiler_options_change_no_result_and_unknown_ones_are_left_out(
    quick, monkeypatch
):
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    options = compiling.compiler_options()
    assert set(options) <= set(compiling.CPU_OPTIONS)
    compiled = draw.lower(key, image, quick).compile(options)
    np.testing.assert_allclose(
        compiled(key, image, quick).range_m, draw(key, image, quick).range_m, atol=1e-4
    )
    monkeypatch.setattr(compiling, "CPU_OPTIONS", {"xla_cpu_no_such_option": True})
    assert compiling.compiler_options.__wrapped__() == {}
