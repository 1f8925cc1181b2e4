"""The study of robustness: its table of shifts."""

import numpy as np
import pytest

from experiments import build
from experiments.studies import robustness
from jradar.evaluation import read_scores
from jradar.simulation import sets


def test_the_table_of_shifts_has_means_and_shares_of_warnings():
    def row(shift, f_score, layout):
        scores = {"chamfer": 1.0, "modified_hausdorff": 0.5, "f_score_0.2": f_score}
        scores |= {"f_score_0.1": 0.0, "f_score_0.5": 0.0, "milliseconds": 1.0}
        place = {"scene": shift, "sequence": f"{shift} {layout}", "frame": 0}
        return (
            place
            | scores
            | {"truth": "LiDAR", "method": "ours", "points": 9, "truth_points": 9}
        )

    scores = [row("clean", 0.8, 0), row("clean", 0.6, 1)]
    scores += [row("noise", 0.3, 0), row("noise", 0.5, 1), row("tilt", 0.2, 0)]
    warnings = {
        ("ours", "clean"): np.array([[0.3, 0.8], [0.6, 0.7]]),
        ("ours", "noise"): np.array([[0.5, 0.6], [1.0, 0.75]]),
        ("ours", "tilt"): np.array([[0.5, 0.4]]),
    }
    table = robustness.shifts_table(scores, warnings)
    assert "| noise | 1.00 / 40.0" in table and "| clean | 1.00 / 70.0" in table
    assert "| **mean over shifts** | **1.00 / 30.0** |  |" in table  # without clean
    assert "| 50, 0 |" in table  # a frame of noise is unlike training
    assert "| 0, 100 |" in table  # the tilted one is warned for its confidence


@pytest.mark.slow
def test_every_shift_is_a_row_of_one_table(records, tmp_path, monkeypatch, capsys):
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    one = build.set_sequences("jradar-sim-2-robust/clean")[:1]
    for module in (build, sets):
        monkeypatch.setattr(module, "set_sequences", lambda name: one)
    detector = (lambda power: power / power.max(), 0.1)
    monkeypatch.setattr(robustness.rpdnet, "detector_of", lambda *_: detector)
    shifts = ["--shift", "clean", "--shift", "standing-still"]
    command = ["-o", str(tmp_path), "--rates", str(records), *shifts]
    command += ["--rpdnet", "runs/rpdnet"]
    assert robustness.main(command) == 0
    rows = read_scores(tmp_path / "evaluation" / "frames.jsonl")
    assert {row["scene"] for row in rows} == {"clean", "standing-still"}
    assert {row["method"] for row in rows} == {"OS-CFAR", "splat", "RPDNet"}
    table = (tmp_path / "evaluation" / "table.md").read_text()
    assert "standing-still" in table
    shifts = (tmp_path / "evaluation" / "shifts.md").read_text()
    assert "| **mean over shifts** |" in shifts
    assert robustness.main(command) == 0  # from the records of before
    assert read_scores(tmp_path / "evaluation" / "frames.jsonl")[0]["frame"] == 0
