"""The command that fits the confidence of a trained model to other records."""

import jax
import numpy as np
import pytest

from experiments import confidence
from experiments.configs import marginal, regression
from jradar.data import Records
from jradar.evaluation.confidence import judged, least_confidence
from jradar.model import load_model, save_model
from jradar.range_image import ConfidenceTable, frequency


@pytest.mark.slow
def test_the_command_fits_the_confidence_to_other_records(records, made, tmp_path):
    _, model = made(marginal)
    wrong = ConfidenceTable.of((1.0, 1.0))
    save_model(tmp_path / "old", model.with_tables(confidence=wrong))
    out = tmp_path / "new"
    command = [str(tmp_path / "old"), str(records), "-o", str(out)]
    assert confidence.main([*command, "--split", "test"]) == 0
    fitted, old = load_model(out), load_model(tmp_path / "old")
    jax.tree.map(np.testing.assert_array_equal, fitted.params, old.params)
    frames, key = Records(records, "test"), jax.random.key(confidence.KEY)
    table = fitted.tables.confidence
    found = [
        points._replace(confidence=np.asarray(frequency(points.confidence, table)))
        for points in judged(key, old, frames)
    ]
    said = np.concatenate([part.confidence for part in found])
    right = np.concatenate([part.right for part in found])
    # Isotonic regression keeps the mean; the 33 knots round it.
    assert 0 < right.mean() < 0.9
    np.testing.assert_allclose(said.mean(), right.mean(), atol=0.02)
    least = least_confidence(found)
    assert float(table.least) == pytest.approx(least)


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
    fitted = plain.with_tables()
    monkeypatch.setattr(confidence, "with_confidence", lambda *_: fitted)
    assert confidence.main(command) == 0
    assert "fitted to 24 frames" in capsys.readouterr().out
