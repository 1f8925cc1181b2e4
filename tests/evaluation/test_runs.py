"""Several runs: names say which run, what all share stands once, differences."""

import re

import jax
import pytest

from experiments.studies import compare
from jradar.evaluation import (
    comparison_table,
    read_runs,
    read_scores,
    runs_table,
    summarise,
    write_scores,
)
from tests.evaluation import invented

KEY = jax.random.key(0)


@pytest.fixture
def runs(tmp_path):
    rows = invented.scores(frames=15)
    for name, factor in (("long", 0.8), ("short", 1.2)):
        scores = [row | {"milliseconds": factor} for row in rows]
        if name == "short":
            scores = [row for row in scores if row["method"] != "RPDNet"]
        for row in scores:
            row["chamfer"] *= factor if row["method"] == "jradar" else 1
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
    with pytest.raises(ValueError, match="reference='ours', expected one of"):
        comparison_table(KEY, read_runs(runs), reference="ours")


def scores_of(runs):
    return [read_scores(run / "evaluation" / "frames.jsonl") for run in runs]


def test_one_run_minus_another(runs):
    first, second = scores_of(runs)
    table = runs_table(KEY, first, second)
    lines = [line for line in table.splitlines() if line.startswith("| jradar")]
    assert ["CD (m)" in line for line in lines] == [True, False, False]
    (cell,) = re.findall(r"CD \(m\) \| ([+-][\d.]+)", lines[0])
    ours = (
        [row for row in rows if row["method"] == "jradar"] for rows in (first, second)
    )
    differences = [b["chamfer"] - a["chamfer"] for a, b in zip(*ours, strict=True)]
    assert float(cell) == pytest.approx(sum(differences) / 60, abs=6e-4)
    assert "+0.000" in lines[1] and "| 1 | 1 |" in lines[1]  # MHD is the same
    assert table.endswith("The same in both: OS-CFAR.\n") and "RPDNet" not in table
    with pytest.raises(ValueError, match="no method in common"):
        runs_table(KEY, first, [row | {"method": "other"} for row in second])


def test_runs_are_compared_by_a_command(runs, tmp_path, capsys):
    long, short = map(str, runs)
    assert compare.main([long, short]) == 0
    assert "second minus first" in capsys.readouterr().out
    assert compare.main([long, short, "--reference", "RPDNet"]) == 0
    out = capsys.readouterr().out
    assert out.count("minus RPDNet") == 3 and "jradar (short)" in out
    assert compare.main([long, "--reference", "nothing"]) == 2
    assert "is none of" in capsys.readouterr().err
    assert compare.main([long, str(tmp_path / "gone")]) == 2
    assert compare.main([long]) == 2
    assert "expected two runs" in capsys.readouterr().err
