"""The demonstration: shipped models get their rows, others are left out."""

import dataclasses

import pytest

from experiments import build, demo
from experiments.configs import demo as config_file
from jradar import recordings
from jradar.data import PrepareSpec, Records, prepare
from jradar.evaluation import read_scores
from jradar.evaluation.report import build_report, load_clouds
from jradar.lidar import LidarSpec
from jradar.model import save_model
from jradar.options import models
from jradar.simulation import sets
from tests.experiments.conftest import random_model
from tests.experiments.tiny_config import shrink
from tests.models import changed, tiny_polar_model
from tests.recordings.small_sequence import write_sequence, write_splits


@pytest.fixture
def config():
    config = shrink(config_file.get_config())
    config.sampling.update(steps=2, draws=2)
    config.evaluation.detectors = ("os", "ca")
    return config


@pytest.fixture
def workdir(tmp_path, config):
    """A workdir that already holds data: frames of a small room, not simulated."""
    write_sequence(tmp_path / "source", "lab_200", frames=2)
    write_splits(tmp_path / "source", {"lab_200": "test"})
    spec = PrepareSpec(lidar=LidarSpec(**build.field_of_view(config.image)))
    records = tmp_path / "run" / "data" / "records"
    prepare(tmp_path / "source", records, spec, workers=1)
    return tmp_path / "run"


@pytest.mark.slow
def test_shipped_models_are_scored(workdir, config, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(models, "WEIGHTS", tmp_path / "weights")
    model = random_model(config, Records(workdir / "data" / "records"))
    far = dataclasses.replace(model.spec.frame_grid.view, max_range_m=15.0)
    plain = {"method": "regression"}
    changes = {"jradar-sim": {}, "more": {}, "other": {"fine": far}, "plain": plain}
    for name, change in changes.items():
        other = dataclasses.replace(model, spec=changed(model.spec, **change))
        save_model(tmp_path / "weights" / name, other)
    save_model(tmp_path / "weights" / "plane", tiny_polar_model())
    demo.evaluate(config, workdir)
    out, err = capsys.readouterr()
    assert "Expect F-scores" in out and "other is for another" in err
    rows = read_scores(workdir / "evaluation" / "frames.jsonl")
    methods = [*dict.fromkeys(row["method"] for row in rows)]
    drawn = ["one-step estimate", "Heun 2", "2 draws"]
    named = [f"{name}, {row}" for name in ("jradar-sim", "more") for row in drawn]
    named.append("plain, direct regression")
    assert methods == ["OS-CFAR", "CA-CFAR", "splat", *named]
    clouds = load_clouds(workdir / "evaluation" / "clouds.npz")
    for named in clouds.values():
        assert [*named] == ["radar", *methods, "LiDAR"]


def test_clouds_pictures_and_scores_stand_beside_the_report(
    workdir, config, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(models, "WEIGHTS", tmp_path / "weights")
    demo.evaluate(config, workdir)
    text = capsys.readouterr().out
    parts = ("ships no model", "| OS-CFAR |", "| ms |")
    assert all(part in text for part in parts) and "Expect" not in text
    out = workdir / "evaluation"
    names = {path.name for path in out.iterdir()}
    pictures = {"curves.png", "clouds.png", "samples.png"}
    assert {"report.html", "table.md", "table.tex", "table.csv"} | pictures <= names
    files = {path.name for path in (out / "clouds" / "lab_200_1").iterdir()}
    clouds = ("radar", "OS-CFAR", "CA-CFAR", "splat", "LiDAR")
    assert files == {f"{name}.ply" for name in clouds}
    cloud = recordings.read_cloud(out / "clouds" / "lab_200_1" / "LiDAR.ply")
    truth = load_clouds(out / "clouds.npz")["lab", "lab_200", 1]["LiDAR"]
    assert (cloud["x"] == truth[:, 0]).all() and len(truth) > 100
    rows = read_scores(out / "frames.jsonl")
    assert {row["frame"] for row in rows} == {0, 1}
    report = build_report(workdir).read_text()  # again, from the files
    assert "lab, lab_200, 1" in report
    assert "<strong>All frames are simulated</strong>" in report


@pytest.mark.slow
def test_layouts_are_of_the_test_split_and_made_once(tmp_path, config, monkeypatch):
    pytest.importorskip("embreex")
    config.data.layouts = 1
    two = [
        s for s in sets.set_sequences(config.data.set) if s.family in ("hall", "lab")
    ]
    monkeypatch.setattr(demo, "set_sequences", lambda name: two)

    def prepared():
        return build.prepared_data(config, tmp_path, write=demo.simulate_layouts)

    folder = prepared()
    records = Records(folder, "test")
    assert {name for name, _ in records.where} == {"hall_200", "lab_200"}
    assert len(records) == 2
    stamp = (folder / "manifest.json").stat().st_mtime_ns
    assert prepared() == folder
    assert (folder / "manifest.json").stat().st_mtime_ns == stamp
