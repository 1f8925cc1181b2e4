"""The curve of own frames: whole walks, and a table of what was gained and lost."""

import types

import pytest

from experiments.studies import own_frames
from jradar.errors import UsageError


def test_frames_are_those_of_whole_walks():
    assert own_frames._walks(50) == {901: 20, 902: 30}
    assert sum(own_frames._walks(200).values()) == 200
    with pytest.raises(UsageError, match="--frames 60: no number of whole walks"):
        own_frames._walks(60)


def test_the_table_has_the_shipped_model_and_each_run(tmp_path, monkeypatch):
    def score(path, *, models, split=None):
        new = split is None
        means = {"OS-CFAR": 10.0, models[0]: 40.0, models[1]: 55.0 if new else 39.0}
        ends = {"from": float("nan"), "to": float("nan")}
        if new:
            ends = {"from": 1.0, "to": 99.0}
        lines = [{"method": k, "F 0.2 m (%)": v, **ends} for k, v in means.items()]
        compared = [
            {"methods": f"{name} minus {models[0]}", "F": mean - means[models[0]]}
            | {**ends, "p": 1.0}
            for name, mean in means.items()
        ]
        tables = {"against the LiDAR": lines, "compared": compared}
        return types.SimpleNamespace(describe=lambda: tables)

    monkeypatch.setattr(own_frames, "score", score)
    own_frames._report(tmp_path, tmp_path, {"runs/replay_20_0": [20, "yes", 100]})
    *_, shipped, tuned = (tmp_path / "curve.md").read_text().splitlines()
    assert shipped == "| 0 |  |  | 40.0 (1.0–99.0) | 40.0 |  |  |"
    expected = (
        "| 20 | yes | 100 | 55.0 (1.0–99.0) | 39.0 | +15.0 (+1.0 to +99.0) | -1.0 |"
    )
    assert tuned == expected
