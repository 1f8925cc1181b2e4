"""The demonstration: what is shipped gets its rows, what does not fit is left out."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import build
from experiments.configs import demo as config_file
from experiments.tasks import demo
from jradar import bundle as bundles, recordings
from jradar.bundle import Bundle, save_bundle
from jradar.data import PrepareSpec, Records, prepare
from jradar.evaluation import load_clouds, read_scores
from jradar.lidar import LidarSpec
from tests.recordings.small_sequence import write_sequence, write_splits


@pytest.fixture
def config():
    config = config_file.get_config()
    config.image.update(coarse=(8, 8), fine=(16, 64))
    config.network.update(channels=8, multipliers=(1, 2), attention_levels=(1,))
    config.network.update(stem=(2, 8), condition_stem=(1, 1))
    config.sampling.update(steps=2, draws=2)
    config.evaluation.detectors = ("os", "ca")
    return config


@pytest.fixture
def workdir(tmp_path, config):
    """A workdir that has its data: frames of a small room for those of a simulation."""
    write_sequence(tmp_path / "source", "lab_200", frames=2)
    write_splits(tmp_path / "source", {"lab_200": "test"})
    spec = PrepareSpec(lidar=LidarSpec(**build.view(config.image)))
    records = tmp_path / "run" / "data" / "records"
    prepare(tmp_path / "source", records, spec, workers=1)
    return tmp_path / "run"


def ship(folder, config, records):
    """A bundle with random weights that fits the config, and one that does not."""
    spec = build.build_spec(config, records)
    pair = build.build_pairs(spec, records)[0]
    shapes = jax.eval_shape(
        spec.network.init,
        jax.random.key(0),
        jnp.zeros((1, *pair.lidar.shape, 2)),
        jnp.zeros(1),
        jnp.asarray(pair.condition[None]),
    )
    rng = np.random.default_rng(0)
    params = jax.tree.map(
        lambda leaf: 0.1 * rng.normal(size=leaf.shape).astype(np.float32), shapes
    )
    save_bundle(folder / "jradar-sim", Bundle(params, spec))
    save_bundle(folder / "more", Bundle(params, spec))
    far = dataclasses.replace(spec.fine, max_range_m=15.0)
    other = dataclasses.replace(spec, fine=far)
    save_bundle(folder / "other", Bundle(params, other))


def test_shipped_weights_are_scored_beside_the_detectors(
    workdir, config, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(bundles, "WEIGHTS", tmp_path / "weights")
    demo.run_evaluation(config, workdir)
    text = capsys.readouterr().out
    assert "No trained weights" in text and "| OS-CFAR |" in text and "| ms |" in text

    ship(tmp_path / "weights", config, Records(workdir / "data" / "records"))
    demo.run_evaluation(config, workdir)
    out, err = capsys.readouterr()
    assert "No trained weights" not in out and "other is for another" in err
    rows = read_scores(workdir / "evaluation" / "frames.jsonl")
    methods = [*dict.fromkeys(row["method"] for row in rows)]
    drawn = ["one-step estimate", "jradar, Heun 2", "jradar, 2 draws"]
    assert methods == ["OS-CFAR", "CA-CFAR", *drawn, *(f"more: {d}" for d in drawn)]
    clouds = load_clouds(workdir / "evaluation" / "clouds.npz")
    for named in clouds.values():
        assert [*named] == ["radar", *methods, "LiDAR"]


def test_clouds_pictures_and_scores_stand_beside_the_report(
    workdir, config, tmp_path, monkeypatch
):
    monkeypatch.setattr(bundles, "WEIGHTS", tmp_path / "weights")
    demo.run_evaluation(config, workdir)
    out = workdir / "evaluation"
    names = {path.name for path in out.iterdir()}
    pictures = {"curves.png", "clouds.png", "samples.png"}
    assert {"report.html", "table.md", "table.tex", "table.csv"} | pictures <= names
    files = {path.name for path in (out / "clouds" / "lab_200_1").iterdir()}
    assert files == {"radar.ply", "OS-CFAR.ply", "CA-CFAR.ply", "LiDAR.ply"}
    cloud = recordings.read_cloud(out / "clouds" / "lab_200_1" / "LiDAR.ply")
    truth = load_clouds(out / "clouds.npz")["lab", "lab_200", 1]["LiDAR"]
    assert (cloud["x"] == truth[:, 0]).all() and len(truth) > 100
    rows = read_scores(out / "frames.jsonl")
    assert {row["frame"] for row in rows} == {0, 1}
    assert "lab, lab_200, 1" in (out / "report.html").read_text()


@pytest.mark.slow
def test_layouts_are_of_the_test_split_and_simulated_once(tmp_path, config):
    pytest.importorskip("embreex")
    config.data.layouts = 1
    folder = demo.simulated_data(config, tmp_path)
    records = Records(folder, "test")
    assert len(records) == 6 and {name[-4:] for name, _ in records.where} == {"_200"}
    stamp = (folder / "manifest.json").stat().st_mtime_ns
    assert demo.simulated_data(config, tmp_path) == folder
    assert (folder / "manifest.json").stat().st_mtime_ns == stamp
