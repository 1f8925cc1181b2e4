"""Confidence of a trained model: fitted to validation frames, with a threshold."""

import dataclasses

import jax
import numpy as np
import pytest

from experiments import confidence
from experiments.configs import marginal, regression
from jradar.data import Records
from jradar.evaluation.confidence import (
    THRESHOLDS,
    Around,
    Judged,
    fitted_echoes,
    judged,
    least_alone,
    least_confidence,
    mean_f_scores,
)
from jradar.metrics import f_score, near_truth
from jradar.model import load_model, save_model
from jradar.range_image import IDENTITY, ConfidenceTable, frequency


def frame(wrong_from):
    """Points on a line, of which those above a confidence are right."""
    truth = np.stack([np.arange(0.0, 100.0, 0.5)] + [np.zeros(200)] * 2, -1)
    confidence = np.linspace(0, 1, 200)
    away = np.where(confidence < wrong_from, 30.0, 0.0)
    xyz = truth + np.stack([0 * away, away, 0 * away], -1)
    return Judged(xyz, confidence, away == 0, truth)


def test_wrong_points_are_cut_off_and_right_ones_kept():
    assert 0.3 <= least_confidence([frame(0.32)]) <= 0.35
    assert least_confidence([frame(0.0)]) == 0.05
    between = least_confidence([frame(0.2), frame(0.5)])
    assert 0.2 <= between <= 0.5
    # Each group counts alike, however many frames it has.
    many, one = [frame(0.5)] * 9, frame(0.0)
    assert least_confidence([*many, one]) > 0.4
    assert least_confidence(many, [one]) == 0.05


def test_scores_above_each_threshold_are_f_scores_of_the_points_kept():
    random = np.random.default_rng(3)
    truth, xyz = random.normal(size=(200, 3)), random.normal(size=(300, 3))
    found = Judged(xyz, random.random(300), near_truth(xyz, truth), truth)
    scores = mean_f_scores([found])
    for least, score in zip(THRESHOLDS, scores, strict=True):
        expected = f_score(xyz[found.confidence >= least], truth)
        assert score == pytest.approx(expected) and score > 0
    nothing = found._replace(confidence=np.zeros(300))
    assert (mean_f_scores([nothing]) == 0).all()


def test_points_alone_need_as_much_as_costs_no_score():
    random = np.random.default_rng(4)
    truth = random.normal(size=(300, 3))
    away = np.where(np.arange(400) < 200, 0.1, 0.3)  # those near an echo are better
    xyz = random.permutation(truth)[random.integers(0, 300, 400)]
    xyz = xyz + random.normal(size=(400, 3)) * away[:, None]
    near = np.arange(400) < 200
    found = Judged(xyz, random.random(400), near_truth(xyz, truth), truth, near)
    scores = [
        f_score(xyz[found.confidence >= np.where(near, 0.2, least)], truth)
        for least in THRESHOLDS
    ]
    before = scores[THRESHOLDS.index(0.2)]
    expected = max(t for t, s in zip(THRESHOLDS, scores, strict=True) if s >= before)
    assert least_alone([found], least=0.2) == expected
    unknown = found._replace(near=None)
    assert least_alone([found, unknown], least=0.2) == 0.2


def test_echoes_are_kept_as_far_as_they_cost_no_score():
    random = np.random.default_rng(2)
    truth = random.uniform(0, 3, (400, 3))
    seen = truth[:200] + random.normal(0, 0.05, (200, 3))
    drawn = Judged(
        np.concatenate([seen, truth[200:250] + 9.0]),
        np.repeat([0.9, 0.1], [200, 50]),
        np.repeat([True, False], [200, 50]),
        truth,
        np.ones(250, bool),
    )
    # Of echoes that gather, those near the other half of the truth, three in four are
    # right; of the others one in fifty.
    count = 400
    crowd = np.repeat([0.8, 0.2], count // 2)
    wrong = random.random(count) > np.where(crowd > 0.5, 0.75, 0.02)
    xyz = truth[200 + np.arange(count) % 200] + 20.0 * wrong[:, None]
    echoes = Around(xyz, crowd, near_truth(xyz, truth))
    table = ConfidenceTable.of((0.0, 1.0), least=0.5)
    frame = drawn._replace(echoes=echoes)
    found = fitted_echoes([frame], table=table)
    assert found is not None
    right = [echoes.right[crowd == c].mean() for c in (0.2, 0.8)]
    np.testing.assert_allclose(frequency(np.array([0.2, 0.8]), found), right, atol=0.05)
    kept = np.asarray(frequency(crowd, found)) >= found.least
    np.testing.assert_array_equal(kept, crowd > 0.5)
    assert fitted_echoes([drawn], table=table) is None


@pytest.mark.slow
def test_the_command_fits_the_confidence_to_other_records(records, made, tmp_path):
    _, model = made(marginal)
    wrong = dataclasses.replace(model, confidence=ConfidenceTable.of((1.0, 1.0)))
    save_model(tmp_path / "old", wrong)
    out = tmp_path / "new"
    command = [str(tmp_path / "old"), str(records), "-o", str(out)]
    assert confidence.main([*command, "--split", "test"]) == 0
    fitted, old = load_model(out), load_model(tmp_path / "old")
    jax.tree.map(np.testing.assert_array_equal, fitted.params, old.params)
    plain = dataclasses.replace(old, confidence=IDENTITY)
    frames, key = Records(records, "test"), jax.random.key(confidence.KEY)
    found = [
        points._replace(
            confidence=np.asarray(frequency(points.confidence, fitted.confidence))
        )
        for points in judged(key, plain, frames)
    ]
    said = np.concatenate([part.confidence for part in found])
    right = np.concatenate([part.right for part in found])
    # Isotonic regression keeps the mean; the 33 knots round it.
    assert 0 < right.mean() < 0.9
    np.testing.assert_allclose(said.mean(), right.mean(), atol=0.02)
    least = least_confidence(found)
    assert float(fitted.confidence.least) == pytest.approx(least)


def test_all_splits_are_taken_and_a_model_without_confidence_is_refused(
    records, made, tmp_path, monkeypatch, capsys
):
    _, plain = made(regression)
    save_model(tmp_path / "old", plain)
    command = [str(tmp_path / "old"), str(records), str(records), "--split", "all"]
    command += ["-o", str(tmp_path / "new")]
    assert confidence.main(command) == 2
    assert "gives no confidence" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    fitted = dataclasses.replace(plain)
    monkeypatch.setattr(confidence, "with_confidence", lambda *_: fitted)
    assert confidence.main(command) == 0
    assert "fitted to 24 frames" in capsys.readouterr().out
