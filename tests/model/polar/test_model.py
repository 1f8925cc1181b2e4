"""Planar models: what they answer, what is kept of them in files, what is refused."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from jradar.diffusion import write_params
from jradar.errors import ModelError
from jradar.model.grids.polar import (
    LIDAR,
    RADAR,
    PolarImage,
    Scaling,
    both_ways,
    describe_planar_model,
    expected_f_score,
    files,
    load_planar_model,
    model as model_module,
    plane_cloud,
    plane_image,
)
from jradar.pipeline import load_model
from jradar.range_image import ConfidenceTable, fit_trust
from jradar.types import PointCloud
from tests.models import tiny_polar_model

MODEL = tiny_polar_model()
SEEN = jax.random.uniform(jax.random.key(1), MODEL.spec.condition_shape)
NOTHING = PointCloud(jnp.zeros((4, 3)), jnp.zeros(4, bool))
EMPTY = PolarImage(jnp.zeros(LIDAR.shape), jnp.zeros(RADAR.shape))


@pytest.fixture
def saved(tmp_path):
    """The description of a model in the folder of its weights."""
    weights = tmp_path / "weights.safetensors"
    write_params(weights, MODEL.params, dtype=np.float32)
    return describe_planar_model(weights, MODEL, folder=tmp_path)


def test_a_model_comes_back_from_its_files_by_any_of_their_names(saved):
    for name in (saved, saved.with_suffix(".safetensors"), saved.parent):
        model = load_planar_model(name)
        assert dataclasses.replace(model.spec, points=MODEL.spec.points) == MODEL.spec
        assert model.card == MODEL.card and model.least_share == 0.6
        jax.tree.map(np.testing.assert_array_equal, model.params, MODEL.params)
    assert repr(load_model(saved)) == repr(MODEL)
    assert "PlanarModel(occupancy, 0.0" in repr(MODEL) and "7 steps" in repr(MODEL)


def test_what_training_looked_like_is_kept(saved, tmp_path):
    assert load_planar_model(saved).trust is None
    trust = fit_trust(np.random.default_rng(0).normal(size=(50, 16)))
    knows = dataclasses.replace(MODEL, trust=trust)
    weights = saved.with_suffix(".safetensors")
    found = load_planar_model(describe_planar_model(weights, knows, folder=tmp_path))
    jax.tree.map(np.testing.assert_array_equal, found.trust, trust)
    older = json.loads(saved.read_text())
    del older["trust"]  # as described before descriptions had it
    saved.write_text(json.dumps(older))
    assert load_planar_model(saved).trust is None


def test_the_confidence_of_the_radars_points_is_kept(saved, tmp_path):
    assert load_planar_model(saved).echoes is None
    echoes = ConfidenceTable.of((0.1, 0.8))
    hears = dataclasses.replace(MODEL, echoes=echoes, echo_share=0.3, least_alone=0.6)
    weights = saved.with_suffix(".safetensors")
    found = load_planar_model(describe_planar_model(weights, hears, folder=tmp_path))
    jax.tree.map(np.testing.assert_array_equal, found.echoes, echoes)
    assert (found.echo_share, found.least_alone) == (0.3, 0.6)
    older = json.loads(saved.read_text())
    for name in ("echoes", "echo_share", "least_alone"):
        del older[name]  # as described before they were there
    saved.write_text(json.dumps(older))
    found = load_planar_model(saved)
    assert found.echoes is None and found.least_alone == 0


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("echoes", [1, 0], "expected two or more that rise"),
        ("echo_share", -1, "echo_share = -1, expected 0 to 1"),
        (
            "trust",
            {"mean": [0, 0], "whitening": [[1]], "distances": [0]},
            "whitening has shape",
        ),
        ("format", 9, "kind 'planar' and format 9, expected 'planar' and 3; an eval"),
        ("kind", "curved", "kind 'curved'"),
        ("scaling", {"offset": [0], "scale": [1, 0]}, "expected two finite numbers"),
        ("weights_sha256", "0", "does not match its digest"),
        ("method", "guess", "method = 'guess', expected one of"),
        ("history", 1000, "history = 1000, expected 1 to 256"),
        ("colour", "red", "unknown field 'colour'"),
        ("noise", {"sigma_data": 0.6}, "sigma_data = 0.6, expected at most 0.5"),
        ("confidence", [1, 0], "expected two or more that rise"),
        ("least_share", "half", "least_share = 'half', expected 0 to 1"),
        ("least_share", 2, "least_share = 2, expected 0 to 1"),
        ("least_alone", None, "least_alone = None, expected 0 to 1"),
        ("network", {"kind": "unet", "channels": 1 << 40}, "channels for arrays"),
        ("network", {"kind": "unet", "channels": 8}, "none match"),
    ],
)
def test_an_unusable_description_is_refused(saved, field, value, message):
    values = json.loads(saved.read_text()) | {field: value}
    saved.write_text(json.dumps(values))
    with pytest.raises(ModelError, match=f"is not usable: .*{message}"):
        load_planar_model(saved)


def test_a_model_that_is_not_there_is_named(tmp_path, monkeypatch, saved):
    monkeypatch.setattr(files, "RESULTS", tmp_path)  # as in a wheel
    with pytest.raises(ModelError, match="no licence.*--config=.*radarhd.py"):
        load_model("radarhd")
    with pytest.raises(ModelError, match="no planar model at nowhere"):
        load_planar_model("nowhere")
    with pytest.raises(ModelError, match="the name of a shipped model"):
        load_model("nowhere")
    saved.with_suffix(".safetensors").unlink()
    with pytest.raises(ModelError, match=r"weights.safetensors is missing"):
        load_planar_model(saved)


def test_the_weights_of_a_clone_are_described():
    model = load_model("radarhd")
    assert model.spec.condition_shape == (*RADAR.shape, 1)
    assert 0 < model.least_share < 1
    assert "licence is not stated" in model.card.trained_on


def test_points_lie_in_the_plane_at_the_pixels_that_are_sure_enough():
    image = plane_image(SEEN, MODEL)
    all_of_them = plane_image(SEEN, MODEL, least_confidence=0.0)
    kept = np.asarray(image.confidence) > 0
    assert 0.05 < kept.mean() < 0.95 and image.confidence.max() <= 1
    least = 0.6 * expected_f_score(all_of_them.confidence)
    np.testing.assert_array_equal(kept, all_of_them.confidence >= least)
    chosen = plane_image(SEEN, MODEL, least_confidence=0.7)
    assert chosen.confidence[chosen.confidence > 0].min() >= 0.7
    np.testing.assert_array_equal(image.radar, SEEN[..., 0])
    cloud = plane_cloud(image, NOTHING, MODEL)
    xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    assert len(xyz) == kept.sum() and not xyz[:, 2].any() and (xyz[:, 0] > -1e-5).all()
    np.testing.assert_allclose(xyz, LIDAR.xyz[kept], atol=1e-5)
    assert cloud.velocity is None


def test_a_point_ahead_and_to_the_left():
    sure = jnp.zeros(LIDAR.shape).at[255, 511].set(0.9).at[128, 255].set(0.7)
    image = PolarImage(sure, jnp.zeros(RADAR.shape))
    cloud = plane_cloud(image, NOTHING, MODEL)
    ahead, left = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    np.testing.assert_allclose(ahead, [5.42, 0, 0], atol=0.02)
    np.testing.assert_allclose(left, [0, 10.8, 0], atol=1e-4)
    np.testing.assert_allclose(sorted(cloud.confidence[cloud.valid]), [0.7, 0.9])


def test_the_radars_points_are_in_the_cloud_where_they_gather():
    crowd = np.random.default_rng(0).normal((5, 2, 0), (0.1, 0.1, 0.0), (40, 3))
    points = PointCloud.from_xyz([*crowd, (3, -3, 0), (4, -4, 2)])
    assert plane_cloud(EMPTY, points, MODEL).valid.size == LIDAR.xyz[..., 0].size
    table = ConfidenceTable.of(np.linspace(0, 1, 3))
    model = dataclasses.replace(MODEL, echoes=table, echo_share=0.6)
    cloud = plane_cloud(EMPTY, points, model)
    kept = np.asarray(cloud.valid)
    assert kept.sum() == 400 and not kept[: LIDAR.xyz[..., 0].size].any()
    away = np.linalg.norm(np.asarray(cloud.xyz)[kept] - (5, 2, 0), axis=1)
    assert away.max() < 0.9
    crowding = np.log(40) / np.log(1024)
    np.testing.assert_allclose(cloud.confidence[kept], crowding, atol=1e-5)
    assert not np.asarray(cloud.confidence)[~kept].any()
    every = plane_cloud(EMPTY, points, model, least_confidence=0.0)
    assert every.valid.sum() == 410  # the last point is 2 m too high
    assert not plane_cloud(EMPTY, points, model, least_confidence=0.6).valid.any()


def test_pixels_away_from_the_radars_points_must_be_surer():
    table = ConfidenceTable.of((0.5, 0.5))
    model = dataclasses.replace(MODEL, echoes=table, least_alone=0.8)
    image = EMPTY._replace(confidence=jnp.full(LIDAR.shape, 0.7))
    points = PointCloud.from_xyz([(5, 2, 0)])
    cloud = plane_cloud(image, points, model)
    pixels = LIDAR.xyz[..., 0].size
    kept = np.asarray(cloud.valid)[:pixels]
    away = np.linalg.norm(LIDAR.xyz.reshape(-1, 3) - (5, 2, 0), axis=1)
    assert kept[away < 0.3].all() and not kept[away > 1.5].any()
    assert not np.asarray(cloud.confidence)[:pixels][~kept].any()
    for surer in (
        plane_cloud(image._replace(confidence=image.confidence + 0.2), points, model),
        plane_cloud(image, points, model, least_confidence=0.7),
        plane_cloud(image, points, dataclasses.replace(model, echoes=None)),
    ):
        assert np.asarray(surer.valid)[:pixels].all()


def test_confidence_is_the_tables_and_falls_where_answers_disagree():
    table = ConfidenceTable.of((0.5, 0.5))
    model = dataclasses.replace(MODEL, confidence=table)
    image = plane_image(SEEN, model)
    np.testing.assert_allclose(image.confidence, 0.5)
    scaling = Scaling.of((0, -2), (1, 0))
    _, (apart,) = both_ways(
        SEEN[None], MODEL.params, MODEL.spec.network, MODEL.spec.noise
    )
    assert 0.01 < apart < 0.6
    lower = plane_image(SEEN, dataclasses.replace(model, scaling=scaling))
    np.testing.assert_allclose(lower.confidence, expit(-2 * apart), atol=1e-4)


def test_the_mirror_image_has_the_mirrored_answer():
    image, mirrored = (
        np.asarray(plane_image(seen, MODEL).confidence)
        for seen in (SEEN, SEEN[:, ::-1])
    )
    np.testing.assert_allclose(mirrored[:, ::-1], image, atol=2e-3)


def test_faint_pixels_are_never_points(monkeypatch):
    """A table is fitted to the others alone."""
    model = dataclasses.replace(MODEL, confidence=ConfidenceTable.of((0.5, 0.5)))
    (value,), _ = both_ways(
        SEEN[None], MODEL.params, MODEL.spec.network, MODEL.spec.noise
    )
    middle = float(jnp.median(value))
    monkeypatch.setattr(model_module, "FAINT", middle)
    image = plane_image.__wrapped__(SEEN, model, least_confidence=0.0)
    clear = abs(value - middle) > 1e-4  # float32 rounds either way
    np.testing.assert_array_equal(
        (image.confidence > 0)[clear], (value > middle)[clear]
    )


def test_without_an_echo_there_is_no_point():
    assert not plane_image(jnp.zeros_like(SEEN), MODEL).confidence.any()


def test_several_conditions_give_the_images_of_each():
    both = jnp.stack([SEEN, SEEN[:, ::-1]])
    many = jax.vmap(lambda seen: plane_image(seen, MODEL))(both)
    for k, seen in enumerate(both):
        one = plane_image(seen, MODEL)
        np.testing.assert_allclose(many.confidence[k], one.confidence, atol=1e-4)


def test_a_condition_of_another_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(64, 64, 1\), the model needs"):
        plane_image(jnp.zeros((64, 64, 1)), MODEL)
