"""The functions from a cube to a dense cloud."""

import dataclasses

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import PREDICTIONS, SOLVERS, NoiseSpec
from jradar.model import (
    Card,
    Model,
    compiling,
    condition,
    draw,
    enhance,
    enhance_points,
)
from jradar.radar import Radar, RadarSpec, radar_points
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    ImageSpec,
    encode_target,
    project,
)
from jradar.types import PointCloud
from tests.models import (
    CONDITION_SHAPE,
    NETWORK,
    RADAR,
    SPEC,
    changed,
    echoes,
    tiny_map_model,
    tiny_model,
    tiny_polar_model,
)

UNIT = Radar(RADAR)
FINE = SPEC.grid.fine
LIDAR = 4.0 + np.sin(np.arange(8 * 32.0)).reshape(FINE.shape)
KEY, IMAGE = jax.random.key(0), jnp.ones(CONDITION_SHAPE)
DRAWN = {"draws": 4, "steps": 2}


@pytest.fixture(scope="module")
def model():
    return tiny_model()


@pytest.fixture(scope="module")
def quick():
    """A model that answers in one evaluation, with a point in every pixel."""
    return tiny_model(method="regression", validity_threshold=-1e6)


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


def oracle(*images, **changes):
    """A model whose clean images are `images`, one for each draw."""
    stored = tuple(tuple(map(tuple, image.tolist())) for image in images)
    noise = NoiseSpec(prediction=PREDICTIONS["clean"])
    changes = {"network": Oracle(stored), "noise": noise, "codec": "log"} | changes
    return Model({}, changed(SPEC, **changes))


def test_the_networks_image_becomes_the_cloud_unless_there_are_no_echoes():
    model = oracle(LIDAR)
    cubes = echoes(), jnp.zeros_like(echoes())
    cloud, empty = (enhance(KEY, cube, UNIT, model, draws=1) for cube in cubes)
    assert cloud.xyz.shape == (8 * 32, 3)
    np.testing.assert_allclose(project(cloud, FINE), LIDAR, atol=1e-4)
    assert not empty.valid.any()


def test_several_draws_give_what_they_agree_on():
    near, far = np.full(FINE.shape, 3.0), np.full(FINE.shape, 6.0)
    model = oracle(near, far, far + 0.1, np.zeros(FINE.shape))
    agreed = draw(KEY, IMAGE, model, **DRAWN)
    np.testing.assert_allclose(agreed.range_m, 6.05, atol=1e-4)
    np.testing.assert_allclose(agreed.confidence, 0.5)
    none = draw(KEY, IMAGE, model, **DRAWN, least_confidence=0.6)
    assert not none.range_m.any()
    assert not draw(KEY, 0 * IMAGE, model, **DRAWN).range_m.any()
    with pytest.raises(ValueError, match="draws=0, expected 1 or more"):
        draw(KEY, IMAGE, model, draws=0)


def test_one_draw_of_few_steps_is_what_ipndm_gives(model):
    options = {"draws": 1, "steps": 3}
    quick = draw(KEY, IMAGE, model, solver=SOLVERS["ipndm3"], **options).range_m
    found = draw(KEY, IMAGE, model, **options).range_m
    assert quick.any()
    np.testing.assert_allclose(found, quick, rtol=1e-5)


def test_a_regression_model_answers_once_and_draws_no_samples():
    model = oracle(LIDAR, method="regression")
    estimate = draw(KEY, IMAGE, model)
    np.testing.assert_allclose(estimate.range_m, LIDAR, atol=1e-4)
    assert estimate.confidence is None
    with pytest.raises(ValueError, match="draws, steps: a model trained by regression"):
        draw(KEY, IMAGE, model, draws=1, steps=3)
    with pytest.raises(ValueError, match="method = 'magic', expected one of"):
        dataclasses.replace(SPEC, method="magic")


def test_one_echo_anywhere_fills_the_image(quick):
    assert not draw(KEY, 0 * IMAGE, quick).range_m.any()
    one = (0 * IMAGE).at[3, 4, 5].set(1.0)
    assert draw(KEY, one, quick).range_m.all()


@pytest.mark.slow
def test_vmap_over_frames_equals_the_loop(quick):
    keys = jax.random.split(KEY, 2)
    cubes = jnp.stack([echoes(seed) for seed in range(2)])
    batch = jax.vmap(enhance, (0, 0, None, None))(keys, cubes, UNIT, quick)
    assert batch.valid.any()
    for i in range(2):
        alone = enhance(keys[i], cubes[i], UNIT, quick)
        np.testing.assert_allclose(batch.xyz[i], alone.xyz, atol=1e-3)


def test_a_radar_of_another_slope_moves_a_target_in_proportion(quick):
    """What a cube without its radar would hide: the slope decides the range."""
    steep = dataclasses.replace(RADAR, slope_hz_per_s=2 * RADAR.slope_hz_per_s)
    points = quick.spec.points.fitted(RADAR)
    near, far = (
        np.linalg.norm(radar_points(echoes(), Radar(radar), points=points).xyz[0])
        for radar in (steep, RADAR)
    )
    assert near == pytest.approx(far / 2, rel=1e-3)


def test_points_of_any_origin_are_enhanced_as_those_of_the_cube(quick):
    points = radar_points(echoes(), UNIT, points=quick.spec.points.fitted(RADAR))
    expected = enhance(KEY, echoes(), UNIT, quick)
    found = enhance_points(KEY, points, quick)
    np.testing.assert_array_equal(found.xyz, expected.xyz)
    np.testing.assert_array_equal(found.velocity, expected.velocity)
    bare = PointCloud(points.xyz, points.valid)
    assert enhance_points(KEY, bare, quick).velocity is None


def test_no_points_give_an_empty_cloud_without_running_the_network(quick):
    none = PointCloud(jnp.zeros((0, 3)), jnp.zeros(0, bool), velocity=jnp.zeros(0))
    assert "convolution" not in enhance_points.lower(KEY, none, quick).as_text()
    found = enhance_points(KEY, none, quick)
    assert found.xyz.shape == (8 * 32, 3) and found.velocity.shape == (8 * 32,)
    assert not found.valid.any()


def test_models_of_other_cards_and_tables_share_programs_and_map_together(quick):
    table = ConfidenceTable.of((0.0, 1.0), least=0.2)
    table = table._replace(frequencies=IDENTITY.frequencies)
    other = dataclasses.replace(quick, card=Card("another", 9)).with_tables(
        confidence=table
    )
    draw(KEY, IMAGE, quick)
    before = draw._cache_size()
    draw(KEY, IMAGE, other)
    assert draw._cache_size() == before
    mean = jax.tree.map(lambda a, b: (a + b) / 2, quick, other)
    assert mean.card == quick.card != other.card
    assert float(mean.tables.confidence.least) == pytest.approx((0.375 + 0.2) / 2)


def test_what_a_user_holds_is_one_line(model):
    for held in (model, UNIT.with_factors(jnp.ones(12)), model.card.radar):
        assert len(repr(held).splitlines()) == 1
    assert len(repr(model)) < 200 and "million parameters" in repr(model)
    assert repr(UNIT).endswith("not calibrated)") and len(repr(UNIT)) < 200


@pytest.mark.slow
def test_a_gradient_reaches_the_parameters(quick):
    slope = jax.jit(jax.grad(lambda model: draw(KEY, IMAGE, model).range_m.mean()))
    found = slope(quick)
    assert isinstance(found, Model) and found.spec == quick.spec
    sizes = [np.abs(leaf).sum() for leaf in jax.tree.leaves(found.params)]
    assert np.isfinite(sizes).all() and sum(sizes) > 0


@pytest.mark.usefixtures("as_a_user")
def test_a_condition_of_another_size_is_refused(model):
    for shape in ((8, 8, 9), (16, 16, 12), (2, 8, 8, 12)):
        with pytest.raises(ValueError, match=r"model needs .* = \(8, 8, 12\)"):
            draw(KEY, jnp.zeros(shape), model, draws=1, steps=1)


def test_a_condition_that_skips_a_level_of_the_network_is_refused():
    """Its grids 8 x 8 and 4 x 4 met two levels; those of 16 x 16 would meet one."""
    two = dataclasses.replace(NETWORK, multipliers=(1, 1), stem=(1, 4))
    model = tiny_model(network=two)
    larger = changed(model.spec, coarse=ImageSpec(16, 16))
    other = Model(model.params, larger)
    with pytest.raises(ValueError, match=r"none is .* where it entered in training"):
        enhance(KEY, echoes(), UNIT, other, draws=1, steps=1)


def test_another_radars_cube_is_refused(model):
    cube = jnp.zeros((2, 4, 32, 64), jnp.complex64)
    with pytest.raises(ValueError, match=r"cube has shape \(2, 4, 32, 64\)"):
        condition(cube, UNIT, model)
    other = Radar(RadarSpec.awr1642(num_chirps=32, num_samples=64))
    shape = jax.eval_shape(lambda c: condition(c, other, model), cube).shape
    assert shape == CONDITION_SHAPE


def test_compiler_options_change_no_result_and_unknown_ones_go(quick, monkeypatch):
    options = compiling.compiler_options()
    assert set(options) <= set(compiling.CPU_OPTIONS)
    compiled = draw.lower(KEY, IMAGE, quick).compile(options)
    found, expected = compiled(KEY, IMAGE, quick), draw(KEY, IMAGE, quick)
    np.testing.assert_allclose(found.range_m, expected.range_m, atol=1e-4)
    monkeypatch.setattr(compiling, "CPU_OPTIONS", {"xla_cpu_no_such_option": True})
    assert compiling.compiler_options.__wrapped__() == {}


def test_a_model_that_has_no_meaning_there_is_refused_by_name():
    maps, plane = tiny_map_model(), tiny_polar_model()
    with pytest.raises(ValueError, match="expected one of a radar's frames"):
        enhance(KEY, echoes(), UNIT, maps)
    points = radar_points(echoes(), UNIT)
    with pytest.raises(ValueError, match="sees a radar's samples.* such as jradar-sim"):
        enhance_points(KEY, points, plane)
    with pytest.raises(ValueError, match="19 channels: one condition, or another"):
        draw(KEY, jnp.zeros((32, 32, 4)), maps)
