"""Rows of the tables: direct regression, detectors; records refused for models."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import build, enhance
from experiments.configs import regression
from jradar import data, evaluation
from jradar.errors import UsageError
from jradar.evaluation.detectors import detected, seen_points, smeared
from jradar.model import Model
from jradar.radar import PointSpec
from jradar.range_image import encode_range
from jradar.types import PointCloud
from tests.recordings.small_sequence import write_sequence


def test_validation_follows_the_tables_rule_for_frames_without_points(records):
    frame = data.Records(records, "train")[0]
    perfect, nothing = frame.lidar_xyz, np.zeros((0, 3))
    truths = [perfect, perfect, nothing]
    found = evaluation.mean_scores([perfect, nothing, perfect], truths)
    assert found == {
        "chamfer": pytest.approx(0, abs=1e-5),
        "f_score_0.2": pytest.approx(0.5),
        "empty": pytest.approx(0.5),
    }


@pytest.fixture(scope="module")
def trained(records, made):
    """A config of direct regression, a model, its training records and pairs."""
    config, model = made(regression)
    frames = data.Records(records, "train")
    return config, model, frames, data.pairs_of(model.spec, frames)


def test_direct_regression_draws_the_networks_answer(trained):
    config, model, frames, pairs = trained
    params, spec, grid = model.params, model.spec, model.spec.grid
    # A network that answers 5 m everywhere, by the bias of its last layer.
    value = encode_range(
        jnp.asarray(5.0), max_range_m=grid.fine.max_range_m, codec=grid.codec
    )
    out = np.float32([value, 1.0]) / spec.noise.sigma_data
    changed = jax.tree.map(np.zeros_like, params)
    changed["params"]["trunk"]["unfold"]["bias"] = np.tile(out, 2 * 8)
    methods = enhance.model_methods(config, Model(changed, spec))
    assert [*methods] == ["direct regression"]
    frame = evaluation.MethodInput(frames[0], pairs[0])
    for key in (0, 1):
        cloud = methods["direct regression"](jax.random.key(key), frame)
        xyz = evaluation.points_of(cloud)
        assert len(xyz) == 16 * 64
        np.testing.assert_allclose(np.linalg.norm(xyz, axis=-1), 5.0, rtol=1e-3)


def test_ranges_of_detections_are_without_the_radars_bias(records):
    frames = data.Records(records, "test")
    view, frame = evaluation.records_in_view(frames), frames[0]
    wide = view._replace(fine=dataclasses.replace(view.fine, max_range_m=100.0))
    mask = np.asarray(frame.cells.power) >= np.sort(frame.cells.power, axis=None)[-20]
    mask[:, : mask.shape[1] // 4] = False  # far enough to be nearer
    plain, mended = (
        evaluation.points_of(seen_points(frame._replace(range_bias_m=bias), mask, wide))
        for bias in (0.0, 0.3)
    )
    assert len(plain) == len(mended) > 0
    lengths = [np.linalg.norm(xyz, axis=-1) for xyz in (plain, mended)]
    np.testing.assert_allclose(lengths[0] - 0.3, lengths[1], atol=1e-5)


def test_detectors_take_the_windows_of_the_records(tmp_path):
    # With a coupling, points of prepared frames come from Blackman windows along range.
    source, folder = tmp_path / "source", tmp_path / "records"
    write_sequence(source, "a", frames=1)
    path = source / "calib" / "single_chip" / "coupling_calib.txt"
    head = "num_tx:3\nnum_rx:4\nnum_range_bins:32\nnum_doppler_bins:16\n"
    path.write_text(f"{head}data:{', '.join(['0'] * 2 * 3 * 4 * 32)}\n")
    rate = 1e-2
    spec = data.PrepareSpec(points=PointSpec(detector="so", false_alarm_rate=rate))
    data.prepare(source, folder, spec, workers=1)
    records = data.Records(folder)
    assert records.windows_of("a") == ("hann", "blackman")
    view, frame = evaluation.records_in_view(records), records[0]
    all_round = {"azimuth": (-3.0, 3.0), "elevation": (-1.5, 1.5), "max_range_m": 99.0}
    view = view._replace(fine=dataclasses.replace(view.fine, **all_round))
    found = evaluation.points_of(detected(frame, view, detector="so", rate=rate))
    expected = evaluation.points_of(frame.radar)
    assert len(expected) > 10 and view.points(frame).range_window == "blackman"
    np.testing.assert_allclose(found, expected, atol=0.01)  # angles are float16


def test_splat_smears_the_points_by_20_cm_to_one_for_each_pixel(records):
    view = evaluation.records_in_view(data.Records(records, "train"))
    middle = PointCloud.from_xyz(np.array([[5.0, 0, 0]]))
    cloud = smeared(jax.random.key(1), middle, view.fine)
    assert cloud.valid.shape == (128 * 512,) and cloud.valid.all()
    np.testing.assert_allclose(cloud.xyz.mean(0), [5, 0, 0], atol=0.01)
    np.testing.assert_allclose(np.cov(cloud.xyz.T), 0.04 * np.eye(3), atol=0.002)
    edge = PointCloud.from_xyz(np.array([[view.fine.max_range_m, 0, 0]]))
    assert smeared(jax.random.key(1), edge, view.fine).valid.mean() == pytest.approx(
        0.5, abs=0.02
    )
    nothing = PointCloud.from_xyz(np.zeros((4, 3)))
    assert not smeared(jax.random.key(1), nothing, view.fine).valid.any()


def test_points_for_the_report_keep_the_confidence_that_a_cloud_has():
    xyz, valid = np.eye(3, dtype=np.float32), np.array([True, False, True])
    plain = PointCloud(jnp.asarray(xyz), jnp.asarray(valid))
    np.testing.assert_array_equal(evaluation.surest_points(plain), xyz[valid])
    sure = plain._replace(confidence=jnp.asarray([0.25, 0.5, 1.0000001]))
    expected = [[1, 0, 0, 0.25], [0, 0, 1, 1]]
    np.testing.assert_array_equal(evaluation.surest_points(sure), expected)


def test_models_are_not_trained_on_directions_by_music_or_a_radars_points(
    trained, monkeypatch
):
    config, _, frames, _ = trained
    frames.manifest["options"]["points"]["angles"] = "music"
    with pytest.raises(UsageError, match="has directions by music"):
        build.build_spec(config, frames)
    frames.manifest["options"]["points"]["angles"] = "fft"
    monkeypatch.setitem(frames.manifest, "radar", None)
    with pytest.raises(UsageError, match="the points that a radar sent, expected"):
        build.build_spec(config, frames)


def test_a_config_for_recordings_asks_for_them(tmp_path):
    config = regression.get_config()
    config.data.set = ""
    with pytest.raises(UsageError, match="--config.data.path"):
        build.prepared_data(config, tmp_path)
    with pytest.raises(UsageError, match="method = 'guess', expected one of"):
        build.build_loss(config.loss, method="guess")


@pytest.mark.slow
def test_frames_with_more_or_fewer_points_are_scored_without_compiling(records, caplog):
    frames = data.Records(records, "train")
    assert len({len(frames[i].lidar_xyz) for i in range(3)}) > 1
    view = evaluation.records_in_view(frames)
    pairs = [data.Pair(None, np.ones(view.fine.shape, np.float32))] * len(frames)
    methods = evaluation.detector_methods(view, {"os": 1e-3})
    jax.clear_caches()  # another test may have compiled the detector
    with jax.log_compiles():
        rows = evaluation.score_records(jax.random.key(0), view, pairs, methods)
        first = next(rows)
        assert any("Compiling" in message for message in caplog.messages)
        caplog.clear()
        others = [next(rows) for _ in range(5)]
    assert len({row["truth_points"] for row in (first, *others)}) > 2
    assert not [message for message in caplog.messages if "Compiling" in message]
