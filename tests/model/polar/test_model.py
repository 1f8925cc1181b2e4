"""Models of polar images: what they answer, and what of it becomes a cloud."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from jradar.diffusion import NoiseSpec
from jradar.errors import UsageError
from jradar.model import PolarGrid, Tables, dense_cloud, draw, load_card, load_model
from jradar.model.grids.base import Question
from jradar.model.grids.polar import LIDAR, RADAR, PolarImage, Scaling, expected_f_score
from jradar.range_image import ConfidenceTable
from jradar.types import PointCloud
from tests.models import tiny_polar_model

KEY = jax.random.key(0)
MODEL = tiny_polar_model()
GRID = PolarGrid()
SEEN = jax.random.uniform(jax.random.key(1), GRID.condition_shape)
NOTHING = PointCloud(jnp.zeros((4, 3)), jnp.zeros(4, bool))
EMPTY = PolarImage(jnp.zeros(LIDAR.shape), jnp.zeros(RADAR.shape), jnp.zeros(()))
PIXELS = LIDAR.xyz[..., 0].size


def test_shipped_models_see_one_image_or_those_of_two_seconds():
    for name, history in (("radarhd", 1), ("radarhd-nearness", 41)):
        model = load_model(name)
        assert model.spec.grid == PolarGrid(history)
        assert 0 < model.tables.confidence.least < 1
        assert "licence is not stated" in load_card(name).trained_on


@pytest.mark.parametrize("history", [0, 1000])
def test_a_history_of_no_or_too_many_images_is_refused(history):
    with pytest.raises(ValueError, match=f"history = {history}, expected 1 to 256"):
        PolarGrid(history)


def test_points_lie_in_the_plane_at_the_pixels_that_are_sure_enough():
    image = draw(KEY, SEEN, MODEL)
    all_of_them = draw(KEY, SEEN, MODEL, least_confidence=0.0)
    kept = np.asarray(image.confidence) > 0
    assert 0.05 < kept.mean() < 0.95 and image.confidence.max() <= 1
    least = 0.6 * expected_f_score(all_of_them.confidence)
    np.testing.assert_array_equal(kept, all_of_them.confidence >= least)
    chosen = draw(KEY, SEEN, MODEL, least_confidence=0.7)
    assert chosen.confidence[chosen.confidence > 0].min() >= 0.7
    np.testing.assert_array_equal(image.radar, SEEN[..., 0])
    cloud = dense_cloud(image, NOTHING, MODEL)
    xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    assert len(xyz) == kept.sum() and not xyz[:, 2].any() and (xyz[:, 0] > -1e-5).all()
    np.testing.assert_allclose(xyz, LIDAR.xyz[kept], atol=1e-5)
    assert cloud.velocity is None


def test_a_point_ahead_and_to_the_left():
    sure = jnp.zeros(LIDAR.shape).at[255, 511].set(0.9).at[128, 255].set(0.7)
    cloud = dense_cloud(EMPTY._replace(confidence=sure), NOTHING, MODEL)
    ahead, left = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    np.testing.assert_allclose(ahead, [5.42, 0, 0], atol=0.02)
    np.testing.assert_allclose(left, [0, 10.8, 0], atol=1e-4)
    np.testing.assert_allclose(sorted(cloud.confidence[cloud.valid]), [0.7, 0.9])


def test_the_radars_points_are_in_the_cloud_where_they_gather():
    crowd = np.random.default_rng(0).normal((5, 2, 0), (0.1, 0.1, 0.0), (40, 3))
    points = PointCloud.from_xyz([*crowd, (3, -3, 0), (4, -4, 2)])
    assert dense_cloud(EMPTY, points, MODEL).valid.size == PIXELS
    table = ConfidenceTable.of(np.linspace(0, 1, 3), least=0.6)
    model = MODEL.with_tables(echoes=table)
    cloud = dense_cloud(EMPTY, points, model)
    kept = np.asarray(cloud.valid)
    assert kept.sum() == 400 and not kept[:PIXELS].any()
    away = np.linalg.norm(np.asarray(cloud.xyz)[kept] - (5, 2, 0), axis=1)
    assert away.max() < 0.9
    crowding = np.log(40) / np.log(1024)
    np.testing.assert_allclose(cloud.confidence[kept], crowding, atol=1e-5)
    assert not np.asarray(cloud.confidence)[~kept].any()
    every = dense_cloud(EMPTY, points, model, least_confidence=0.0)
    assert every.valid.sum() == 410  # the last point is 2 m too high
    assert not dense_cloud(EMPTY, points, model, least_confidence=0.6).valid.any()


def test_pixels_away_from_the_radars_points_must_be_surer():
    surely = MODEL.tables.confidence._replace(least_alone=np.float32(0.8))
    hears = ConfidenceTable.of((0.5, 0.5))
    model = MODEL.with_tables(confidence=surely, echoes=hears)
    image = EMPTY._replace(confidence=jnp.full(LIDAR.shape, 0.7))
    points = PointCloud.from_xyz([(5, 2, 0)])
    cloud = dense_cloud(image, points, model)
    kept = np.asarray(cloud.valid)[:PIXELS]
    away = np.linalg.norm(LIDAR.xyz.reshape(-1, 3) - (5, 2, 0), axis=1)
    assert kept[away < 0.3].all() and not kept[away > 1.5].any()
    assert not np.asarray(cloud.confidence)[:PIXELS][~kept].any()
    for surer in (
        dense_cloud(image._replace(confidence=image.confidence + 0.2), points, model),
        dense_cloud(image, points, model, least_confidence=0.7),
        dense_cloud(image, points, model, fused=True),
        dense_cloud(image, points, model.with_tables(echoes=None)),
    ):
        assert np.asarray(surer.valid)[:PIXELS].all()


def test_confidence_is_the_tables_and_falls_where_answers_disagree():
    table = ConfidenceTable.of((0.5, 0.5))
    model = MODEL.with_tables(confidence=table)
    image = draw(KEY, SEEN, model)
    np.testing.assert_allclose(image.confidence, 0.5)
    apart = float(image.disagreement)
    assert 0.01 < apart < 0.6
    lower = draw(KEY, SEEN, model.with_tables(scaling=Scaling.of((0, -2), (1, 0))))
    np.testing.assert_allclose(lower.confidence, expit(-2 * apart), atol=1e-4)


def test_faint_pixels_are_never_points():
    """A table is fitted to the others alone."""
    image = EMPTY._replace(confidence=jnp.array([[0.0, 0.019, 0.021, 1.0]]))
    found = GRID.calibrated(image, Tables(ConfidenceTable.of((0.5, 0.5))))
    assert found.confidence.tolist() == [[0, 0, 0.5, 0.5]]


def test_without_an_echo_there_is_no_point():
    assert not draw(KEY, jnp.zeros_like(SEEN), MODEL).confidence.any()


def test_the_mirror_image_has_the_mirrored_answer():
    image, mirrored = (
        np.asarray(draw(KEY, seen, MODEL).confidence) for seen in (SEEN, SEEN[:, ::-1])
    )
    np.testing.assert_allclose(mirrored[:, ::-1], image, atol=2e-3)


def test_several_conditions_give_the_images_of_each():
    both = jnp.stack([SEEN, SEEN[:, ::-1]])
    many = jax.vmap(lambda seen: draw(KEY, seen, MODEL))(both)
    for k, seen in enumerate(both):
        one = draw(KEY, seen, MODEL)
        np.testing.assert_allclose(many.confidence[k], one.confidence, atol=1e-4)


def test_a_condition_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(64, 64, 1\), the model needs"):
        draw(KEY, jnp.zeros((64, 64, 1)), MODEL)


WALL = np.zeros(RADAR.shape, np.float32)
WALL[100:120, 40:] = 1  # to the left


def left_and_right(method, network, **sampling):
    """The answer of a network that draws `network(condition)`, and both its sides."""

    def denoise(condition):
        clean = jnp.repeat(network(condition), 8, axis=2)
        return lambda x, sigma: jnp.broadcast_to(clean, x.shape)

    condition = jnp.asarray(WALL)[..., None]
    asked = Question(KEY, denoise, condition, NoiseSpec(sigma_data=0.5), 1.0)
    image = GRID.answer(method, asked, **sampling)
    found = np.asarray(image.confidence)
    left, right = found[105:115, 330:500], found[105:115, 12:182]
    assert np.ptp(left) == np.ptp(right) == 0 and not found[130:].any()
    return image, (float(left[0, 0]), float(right[0, 0]))


def knows(condition):
    return condition


def guesses(condition):
    """Draws the wall on the left, wherever the radar saw it."""
    return jnp.asarray(WALL)[None, ..., None]


@pytest.mark.parametrize(
    ("method", "sampling", "guessed"),
    [
        ("occupancy", {}, (1 / 2, 1 / 2)),
        ("nearness", {}, (1 / 2, 1 / 2)),
        ("diffusion", {"draws": 2}, (1 / 2, 1 / 2)),
        ("diffusion", {"draws": 3}, (2 / 3, 1 / 3)),
    ],
)
def test_a_guess_is_less_sure_than_what_is_also_seen_in_the_mirror(
    method, sampling, guessed
):
    image, sides = left_and_right(method, knows, **sampling)
    assert sides == pytest.approx((1, 0)) and float(image.disagreement) < 1e-6
    image, sides = left_and_right(method, guesses, **sampling)
    assert sides == pytest.approx(guessed)
    assert float(image.disagreement) == pytest.approx(1)


def test_a_single_draw_has_no_other_to_agree_with():
    image, sides = left_and_right("diffusion", guesses, draws=1)
    assert sides == (1, 0) and float(image.disagreement) == 0
    with pytest.raises(ValueError, match="draws=0, expected 1 or more"):
        left_and_right("diffusion", knows, draws=0)


def test_a_model_of_draws_gives_shares_of_them_and_one_of_one_pass_takes_none():
    all_of_them = ConfidenceTable.of((0.0, 1.0), least=0.0)
    model = tiny_polar_model(method="diffusion")
    model = model.with_tables(confidence=all_of_them, scaling=None)
    quick = {"draws": 4, "steps": 1}
    first, again, other = (
        draw(key, SEEN, model, **quick) for key in (KEY, KEY, jax.random.key(1))
    )
    votes = 4 * np.asarray(first.confidence)
    np.testing.assert_allclose(votes, votes.round(), atol=1e-5)
    assert len({*votes.round().ravel().tolist()}) > 2
    np.testing.assert_array_equal(first.confidence, again.confidence)
    assert (first.confidence != other.confidence).any()
    assert (
        dense_cloud(first, NOTHING, model).valid.sum() == (first.confidence > 0).sum()
    )
    with pytest.raises(UsageError, match="draws: a model of one pass draws no samples"):
        draw(KEY, SEEN, MODEL, draws=2)
