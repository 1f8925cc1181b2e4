"""Scores on one's own recordings: two truths, rings, splits, and what is refused."""

import dataclasses

import jax
import numpy as np
import pytest

from jradar import data
from jradar.data import PrepareSpec, prepare
from jradar.data.frames import prepare_frame
from jradar.errors import UsageError
from jradar.evaluation import read_scores
from jradar.evaluation.scoring import WHOLE, _split, score
from jradar.lidar import LidarSpec
from jradar.model import save_model
from jradar.recordings import open_recording
from tests.models import SPEC, tiny_model, tiny_polar_model
from tests.recordings.coloradar_writer import write_calib
from tests.recordings.small_sequence import AT_BASE, SIZES, write_sequence

VIEW = {k: getattr(SPEC.grid.fine, k) for k in ("azimuth", "elevation", "max_range_m")}


@pytest.fixture(scope="module")
def walks(tmp_path_factory):
    root = tmp_path_factory.mktemp("walks")
    return [write_sequence(root, name, frames=2, seed=k) for k, name in enumerate("ab")]


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    """Two models of the same images; one names the bins that are the default."""
    folder = tmp_path_factory.mktemp("models")
    for name, scale, bins in (("one", 1.0, None), ("two", 0.5, 64)):
        model = tiny_model(method="regression")
        points = dataclasses.replace(model.spec.points, num_azimuth=bins)
        spec = dataclasses.replace(model.spec, points=points)
        params = jax.tree.map(lambda leaf, scale=scale: scale * leaf, model.params)
        save_model(folder / name, dataclasses.replace(model, params=params, spec=spec))
    return [str(folder / name) for name in ("one", "two")]


@pytest.fixture(scope="module")
def found(walks, models):
    return score(walks, models=models)


@pytest.mark.slow
def test_two_processes_score_as_one_does(found, walks, models):
    both = score(walks, models=models, workers=2)
    timed = "milliseconds"
    assert [row | {timed: 0} for row in both.rows] == [
        row | {timed: 0} for row in found.rows
    ]
    assert str(both.rings) == str(found.rings)  # NaN, too
    assert both.clouds.keys() == found.clouds.keys()
    for name, parts in found.confidence.items():
        for one, two in zip(parts, both.confidence[name], strict=True):
            np.testing.assert_array_equal(one, two)


@pytest.mark.slow
def test_methods_are_scored_against_the_seen_part_and_the_whole(found, walks, models):
    methods, truths = ["OS-CFAR", "splat", *models], ["LiDAR", WHOLE]
    names = {(r["sequence"], r["frame"], r["truth"], r["method"]) for r in found.rows}
    assert names == {
        (walk, frame, truth, method)
        for walk in "ab" for frame in (0, 1) for truth in truths for method in methods
    }  # fmt: skip
    recording, spec = open_recording(walks[0]), PrepareSpec(lidar=LidarSpec(**VIEW))
    prepared, steps, _ = prepare_frame(recording, 1, 1, spec)
    whole = data.lidar_in_view(recording, prepared, spec.lidar)
    np.testing.assert_array_equal(whole, steps.xyz[steps.in_view])
    counts = {
        row["truth"]: row["truth_points"]
        for row in found.rows
        if (row["sequence"], row["frame"]) == ("a", 1)
    }
    assert counts[WHOLE] == len(whole) > counts["LiDAR"] > 0


def test_rings_share_out_the_points(found):
    for row in found.rows:
        if row["truth"] == "LiDAR":
            same = ("sequence", "frame", "method")
            rings = [r for r in found.rings if all(r[k] == row[k] for k in same)]
            assert [r["distance"] for r in rings][0] == "0 to 3 m"
            assert sum(r["truth_points"] for r in rings) == row["truth_points"]
            assert sum(r["points"] for r in rings) == row["points"]


def test_tables_name_the_rate_the_missing_interval_and_the_first_model(found, models):
    tables = found.describe()
    lines = tables["against the LiDAR"]
    assert [line["method"] for line in lines] == ["OS-CFAR", "splat", *models]
    of_splat = [
        row["f_score_0.2"] for row in found.rows
        if (row["truth"], row["method"]) == ("LiDAR", "splat")
    ]  # fmt: skip
    assert lines[1]["F 0.2 m (%)"] == pytest.approx(100 * np.mean(of_splat))
    assert lines[0]["frames"] == 4 and np.isnan(lines[0]["from"])
    notes = " ".join(found.notes)
    assert "4 frames are too few for some intervals" in notes
    assert "OS-CFAR has a false-alarm rate of " in notes
    compared = [line["methods"] for line in tables["compared"]]
    others = ("OS-CFAR", "splat", models[1])
    assert compared == [f"{m} minus {models[0]}" for m in others]
    of = {line["method"]: line["F 0.2 m (%)"] for line in lines}
    for name, line in zip(others, tables["compared"], strict=True):
        expected = of[name] - of[models[0]]
        assert line["F 0.2 m (points)"] == pytest.approx(expected, abs=1e-6)


def test_the_folder_holds_scores_tables_pictures_and_clouds(found, tmp_path):
    report = found.write(tmp_path)
    names = {path.name for path in report.parent.iterdir()}
    assert {"frames.jsonl", "table.md", "samples.png", "distance.png"} <= names
    assert len(read_scores(report.parent / "frames.jsonl")) == len(found.rows)
    assert (report.parent / "clouds" / "a_0" / "LiDAR.ply").is_file()


def test_records_score_their_test_or_validation_frames(walks, models, found, tmp_path):
    spec = PrepareSpec(points=SPEC.points, lidar=LidarSpec(**VIEW))
    records = tmp_path / "records"
    prepare(walks, records, spec, workers=1, splits={"b": "validation"})
    of_records = score(records, models=models[:1])
    assert of_records.records == {"b": 2}
    for row in of_records.rows:  # as from the recording itself
        if row["method"] == models[0]:
            (same,) = (
                r for r in found.rows
                if all(r[k] == row[k] for k in ("sequence", "frame", "method", "truth"))
            )  # fmt: skip
            assert row["f_score_0.2"] == pytest.approx(same["f_score_0.2"], abs=1e-6)
    with pytest.raises(UsageError, match=r"no test frames.*--test NAME"):
        score(records, models=models[:1], split="test")
    both, splits = tmp_path / "both", {"b": "validation", "a": "test"}
    prepare(walks, both, spec, workers=1, splits=splits, frames=slice(0, 1))
    for split in (None, "validation"):
        assert _split(both, split) == (split or "test")
    with pytest.raises(UsageError, match="one folder of records"):
        score([records, walks[0]], models=models[:1])


def test_the_end_of_a_walk_is_scored_under_its_own_name(models, tmp_path):
    walk = write_sequence(tmp_path, "walk", frames=60)
    spec = PrepareSpec(points=SPEC.points, lidar=LidarSpec(**VIEW))
    part = slice(20, 60)
    prepare(walk, tmp_path / "r", spec, workers=1, frames=part, validation_share=0.05)
    found = score(tmp_path / "r", models=models[:1])
    assert found.records == {"walk-end": 2} and {s for _, s, _ in found.clouds} == {
        "walk-end"
    }


@pytest.mark.slow
def test_a_model_of_one_row_is_compared_in_its_plane(walks, tmp_path):
    save_model(tmp_path / "plane", tiny_polar_model())
    found = score(walks, models=[tmp_path / "plane"])
    assert {row["truth"] for row in found.rows} == {"LiDAR", WHOLE}
    for named in found.clouds.values():
        for name in ("LiDAR", "OS-CFAR", "splat", str(tmp_path / "plane")):
            assert not named[name][:, 2].any()
    plane = [row for row in found.rows if row["truth"] == "LiDAR"]
    assert sum(row["points"] for row in plane) > 0
    assert any("all points lie at height 0" in note for note in found.notes)


def test_models_that_see_something_else_are_refused(walks, models, tmp_path):
    wide = dataclasses.replace(SPEC.grid.fine, max_range_m=20.0)
    save_model(tmp_path / "wide", tiny_model(method="regression", fine=wide))
    with pytest.raises(UsageError, match=r"wide has fine\.max_range_m = 20\.0, .*12"):
        score(walks, models=[models[0], tmp_path / "wide"])


def test_radars_of_other_antennas_are_refused(walks, models, tmp_path):
    antennas = "F_design 76.8\n" + "".join(f"rx {k} {k} 0\n" for k in range(4))
    antennas += "tx 0 0 0\ntx 1 4 0\ntx 2 8 0\n"
    write_calib(tmp_path / "calib", transforms=AT_BASE, sizes=SIZES, antennas=antennas)
    other = write_sequence(tmp_path, "other", frames=1)
    with pytest.raises(ValueError, match="2 radars .* whose antennas differ"):
        score([walks[0], other], models=models[:1])


def test_a_recording_without_lidar_says_so(models, small_cube_file):
    with pytest.raises(ValueError, match="has no LiDAR: .* capture.toml"):
        score(small_cube_file, models=models[:1])


@pytest.fixture
def small_cube_file(tmp_path):
    np.save(tmp_path / "cube.npy", np.ones((1, 3, 4, 8, 32), np.complex64))
    (tmp_path / "radar.toml").write_text(
        '[radar]\ndevice = "awr1843"\nnum_chirps = 8\nnum_samples = 32\n'
        '[file]\naxes = ["frame", "tx", "rx", "chirp", "sample"]\n'
    )
    return tmp_path / "cube.npy"


def test_a_lidar_that_sees_nothing_in_view_says_so(models, tmp_path):
    walk = write_sequence(tmp_path, "walk", frames=1)
    for scan in (walk / "lidar" / "pointclouds").iterdir():
        scan.write_bytes(np.float32([[-3, 0.1, 0.1, 9], [-3, 0.2, 0, 9]]).tobytes())
    with pytest.raises(ValueError, match="no LiDAR point is in view"):
        score(walk, models=models[:1])
