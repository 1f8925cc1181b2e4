"""The curve of own frames: whole walks, and a table of what was gained and lost."""

import types

import pytest

from experiments.studies import own_frames
from jradar.errors import UsageError
from jradar.evaluation.records import TRUTH
from jradar.simulation import drawn_sources
from jradar.simulation.sets import SETS


def test_frames_are_those_of_whole_walks():
    assert own_frames.walks_for(50) == [901, 902]
    assert own_frames.walks_for(400) == [*own_frames.WALKS]
    for wrong in (60, 0, 401):
        with pytest.raises(UsageError, match="expected one of .20, 50, 100, 150, 200"):
            own_frames.walks_for(wrong)


def test_training_knows_neither_the_rigs_nor_their_places():
    trained = {family for spec in SETS.values() for family in spec.families}
    trained |= {source.kind for source in drawn_sources("jradar-sim-5")}
    for family, unit in own_frames.RIGS.values():
        assert family not in trained
        assert unit.board >= own_frames.FIRST_SHIFT and unit.calibration_degrees is None


def test_the_table_has_the_shipped_model_and_means_over_seeds(tmp_path, capsys):
    def rows(method, score, truth=TRUTH):
        return [
            {"scene": "", "sequence": f"walk_{k}", "frame": 0, "method": method}
            | {"truth": truth, "f_score_0.2": score + 0.01 * (k % 2)}
            | {"truth_points": 9, "points": 9}
            for k in range(8)
        ]

    def place(first, second):
        scores = rows("jradar-sim", 0.4) + rows("jradar-sim", 0.9, "whole LiDAR")
        return types.SimpleNamespace(rows=scores + rows("a", first) + rows("b", second))

    places = {"new place": place(0.5, 0.6), "old places": place(0.38, 0.40)}
    runs = [own_frames.Run(20, "default", 100, ["a", "b"])]
    own_frames.report(tmp_path / "curve.md", places, runs)
    *_, shipped, tuned = (tmp_path / "curve.md").read_text().splitlines()
    new, old = "40.5 (40.1–40.9)", "40.5 (40.1–40.9)"
    assert shipped == f"| 0 |  |  | {new} | {old} |  |  |"
    assert tuned.startswith(
        "| 20 | default | 100 | 55.5 (55.1–55.9) | 39.5 (39.1–39.9) |"
    )
    assert tuned.endswith("| +15.0 (+15.0 to +15.0) | -1.0 (-1.0 to -1.0) |")
    assert tuned in capsys.readouterr().out
