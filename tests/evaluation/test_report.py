"""A run's report is built from its folder, rebuilt when its parts change."""

import json
import os
import webbrowser

import numpy as np
import pytest
from matplotlib.image import imread

from jradar.cli import main
from jradar.errors import UsageError
from jradar.evaluation import open_report, read_scores, write_scores
from jradar.evaluation.report import build_report, load_clouds, save_clouds
from jradar.recordings import read_cloud
from tests.evaluation import invented


def points(seed, count, *, columns=3):
    """Points of float32; the fourth column is between 0 and 1."""
    rng = np.random.default_rng(seed)
    xyz, confidence = rng.normal(size=(count, 3)), rng.uniform(size=(count, 1))
    return np.hstack([xyz, confidence])[:, :columns].astype(np.float32)


CLOUDS = {
    ("Hallways", "run3", i): {
        "OS-CFAR": points(i, 30),
        "jradar": points(i, 400, columns=4),
        "LiDAR": points(i, 900),
    }
    for i in (0, 7)
}


@pytest.fixture
def run(tmp_path):
    folder = tmp_path / "run" / "evaluation"
    truths = ("LiDAR", "re-projected")
    write_scores(folder / "frames.jsonl", invented.scores(frames=9, truths=truths))
    save_clouds(folder / "clouds.npz", CLOUDS)
    metrics = [json.dumps({"step": i, "loss": 1 / (i + 1)}) for i in range(30)]
    (tmp_path / "run" / "metrics.jsonl").write_text("\n".join(metrics))
    return tmp_path / "run"


def test_clouds_come_back(tmp_path):
    save_clouds(tmp_path / "clouds.npz", CLOUDS)
    found = load_clouds(tmp_path / "clouds.npz")
    assert found.keys() == CLOUDS.keys()
    for place, named in CLOUDS.items():
        assert [*found[place]] == [*named]
        for name, xyz in named.items():
            np.testing.assert_array_equal(found[place][name], xyz)


def test_the_report_says_who_wins_by_how_much_and_on_what(run):
    text = build_report(run).read_text()
    scores = read_scores(run / "evaluation" / "frames.jsonl")
    rows = [row for row in scores if row["truth"] == "LiDAR"]
    mean = {
        name: np.mean([100 * r["f_score_0.2"] for r in rows if r["method"] == name])
        for name in ("jradar", "OS-CFAR")
    }
    gain = mean["jradar"] - mean["OS-CFAR"]
    assert "<strong>jradar</strong> has the best F-score" in text
    assert f"0.2 m: {mean['jradar']:.1f} % on average" in text
    assert f"{gain:.1f} points above OS-CFAR" in text  # not RPDNet, the second
    assert "over 36 frames of Hallways, Outdoor." in text
    assert '"shown": ["OS-CFAR", "jradar", "LiDAR"]' in text


def test_one_method_alone_has_no_rival(run):
    rows = [r for r in invented.scores(frames=3) if r["method"] == "jradar"]
    write_scores(run / "evaluation" / "frames.jsonl", rows)
    text = build_report(run).read_text()
    assert "points above" not in text and "over 12 frames of" in text
    blind = [row | {"truth_points": 0} for row in rows]
    write_scores(run / "evaluation" / "frames.jsonl", blind)
    assert "No frame has a true point." in build_report(run).read_text()


def one_cloud(path, cloud):
    save_clouds(path, {("a", "b", 0): {"c": np.array(cloud)}})


def index_of(path, index, **arrays):
    np.savez(path, index=np.array(index), **arrays)


INDEX = '[["a", "b", 0, "c"]]'
DAMAGES = {
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-50]),
    "text": lambda path: path.write_text("no archive"),
    "array": lambda path: index_of(path, INDEX, cloud_0=np.zeros(3)),
    "nan": lambda path: one_cloud(path, [[np.nan] * 3]),
    "confidence": lambda path: one_cloud(path, [[1, 2, 3, 1.5]]),
    "columns": lambda path: one_cloud(path, np.ones((2, 5))),
    "pickle": lambda path: index_of(path, [{}]),
    "index": lambda path: index_of(path, INDEX),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_clouds_are_refused(tmp_path, damage):
    path = tmp_path / "clouds.npz"
    save_clouds(path, CLOUDS)
    DAMAGES[damage](path)
    message = "1.5, expected 0 to 1" if damage == "confidence" else "evaluate the"
    with pytest.raises(ValueError, match=f"clouds.npz is damaged or not .*{message}"):
        load_clouds(path)


def test_files_of_clouds_hold_the_confidence_of_those_that_have_it(run):
    build_report(run)
    folder = run / "evaluation" / "clouds" / "run3_7"
    named = CLOUDS["Hallways", "run3", 7]
    dense, sparse = (read_cloud(folder / f"{n}.ply") for n in ("jradar", "OS-CFAR"))
    assert [*sparse] == ["x", "y", "z"]
    assert [*dense] == ["x", "y", "z", "confidence"]
    np.testing.assert_array_equal(np.stack([*dense.values()], 1), named["jradar"])


@pytest.mark.parametrize("name", ["../../stolen", "/tmp/stolen"])
def test_clouds_are_written_inside_the_folder_of_the_run(run, name):
    clouds = {("Hallways", name, 0): CLOUDS["Hallways", "run3", 0]}
    save_clouds(run / "evaluation" / "clouds.npz", clouds)
    before = sorted(run.parent.rglob("*"))
    with pytest.raises(ValueError, match="clouds.npz"):
        build_report(run)
    assert sorted(run.parent.rglob("*")) == before


def test_own_files_in_place_of_the_clouds_stay(run):
    mine = run / "evaluation" / "clouds" / "thesis.txt"
    mine.parent.mkdir()
    mine.write_text("years of work")
    with pytest.raises(UsageError, match="clouds holds thesis.txt but no clouds.txt"):
        build_report(run)
    assert mine.read_text() == "years of work"


def test_report_holds_tables_curves_and_clouds(run):
    text = build_report(run).read_text()
    assert "All scenes, against LiDAR" in text
    assert "Scenes, against LiDAR" in text and "Scenes, against re-projected" in text
    assert text.count("data:image/png") == 3  # curves, clouds, training
    assert "Hallways, run3, 7" in text and "<th>ms</th>" in text
    sure = CLOUDS["Hallways", "run3", 7]["jradar"][:, 3].mean()
    low = ", do not trust" if sure < 0.5 else ""
    assert '"may be right"' in text and f'"{sure:.0%}{low}"' in text
    for part in ("clouds.npz", "../metrics.jsonl"):
        (run / "evaluation" / part).unlink()
    assert build_report(run).read_text().count("data:image/png") == 1


def test_report_is_rebuilt_when_a_part_is_newer_and_opened_once(run, monkeypatch):
    opened = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    path = open_report(run, show=False)
    assert path == run / "evaluation" / "report.html" and not opened
    first = path.stat().st_mtime_ns
    assert open_report(run) == path and opened == [path.resolve().as_uri()]
    assert path.stat().st_mtime_ns == first
    scores = run / "evaluation" / "frames.jsonl"
    later = path.stat().st_mtime + 5
    os.utime(scores, (later, later))
    assert open_report(run, show=False).stat().st_mtime_ns > first


def test_the_command_prints_what_to_open(run, capsys):
    assert main(["view", str(run), "--no-open"]) == 0
    report = run / "evaluation" / "report.html"
    assert report.resolve().as_uri() in capsys.readouterr().out


def test_a_run_that_was_not_evaluated(tmp_path):
    with pytest.raises(FileNotFoundError, match="evaluate .* first"):
        open_report(tmp_path)


def test_the_figure_of_clouds_is_no_larger_for_many_scenes(run):
    def height(scenes):
        clouds = {
            (f"scene {i}", f"run{i}", 0): {"jradar": points(i, 20)}
            for i in range(scenes)
        }
        save_clouds(run / "evaluation" / "clouds.npz", clouds)
        build_report(run)
        return len(imread(run / "evaluation" / "clouds.png"))

    assert height(2) < height(6) == height(8)
