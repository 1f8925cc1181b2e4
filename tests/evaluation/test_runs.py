"""Several runs: names say which run, what all share stands once, differences."""

import re

import jax
import pytest

from jradar.evaluation import comparison_table, read_runs, summarise, write_scores
from tests.evaluation import invented

KEY = jax.random.key(0)


@pytest.fixture
def runs(tmp_path):
    rows = invented.scores(frames=15)
    for name, factor in (("long", 0.8), ("short", 1.2)):
        scores = [
            row
            | {
                "chamfer": row["chamfer"]
                * (factor if row["method"] == "jradar" else 1),
                "milliseconds": factor,
            }
            for row in rows
            if name == "long" or row["method"] != "RPDNet"
        ]
        write_scores(tmp_path / name / "evaluation" / "frames.jsonl", scores)
    return [tmp_path / "long", tmp_path / "short"]


def test_methods_are_named_after_runs_where_they_differ(runs):
    scores = read_runs(runs)
    means = {
        row["method"]: row["chamfer"].mean
        for row in summarise(scores)
        if row["scene"] == "Hallways"
    }
    assert [*means] == ["OS-CFAR", "RPDNet", "jradar (long)", "jradar (short)"]
    ratio = means["jradar (short)"] / means["jradar (long)"]
    assert ratio == pytest.approx(1.5)
    assert len(scores) == 4 * 2 * 2 * 15
    with pytest.raises(ValueError, match="two runs are called long"):
        read_runs([runs[0], runs[0]])


def test_differences_from_a_reference(runs):
    table = comparison_table(KEY, read_runs(runs), reference="jradar (long)")
    lines = table.splitlines()
    assert len(lines) == 5 and len({line.count("|") for line in lines}) == 1
    short = next(line for line in lines if "jradar (short)" in line)
    numbers = map(float, re.findall(r"[+-]?\d[\d.e-]*", short)[:5])
    mean, low, high, t_test, sign_flip = numbers
    assert 0 < low < mean < high and t_test < 0.05
    assert 0.1 < sign_flip < 0.2  # four blocks: no p-value below 2 / 2**4
    assert "| 60 | 0 |" in short
    with pytest.raises(ValueError, match="reference='ours' is none of"):
        comparison_table(KEY, read_runs(runs), reference="ours")
