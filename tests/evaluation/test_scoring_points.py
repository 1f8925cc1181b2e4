"""Scores on the points that a radar sent: rows, values by hand, and what is refused."""

import dataclasses

import numpy as np
import pytest

from jradar.data import PrepareSpec, lidar_in_view, prepare
from jradar.data.frames import prepare_frame
from jradar.errors import UsageError
from jradar.evaluation.detectors import in_view
from jradar.evaluation.scoring import SENT, WHOLE, score
from jradar.lidar import LidarSpec
from jradar.model import save_model
from jradar.recordings import open_recording
from tests.models import SPEC, tiny_model, tiny_polar_model
from tests.recordings.points.astyx_writer import AWAY, SIZES, write_astyx

VIEW = {k: getattr(SPEC.grid.fine, k) for k in ("azimuth", "elevation", "max_range_m")}
PREPARED = PrepareSpec(points=SPEC.points, lidar=LidarSpec(**VIEW))
BOTH = ("wall", "pillar")


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walks")
    return write_astyx(folder / "walk.npz", [BOTH, BOTH, ()])


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "tiny"
    save_model(folder, tiny_model(method="regression"))
    return str(folder)


@pytest.fixture(scope="module")
def found(walk, model):
    return score(walk, models=[model])


def test_the_rows_are_the_radars_points_their_splat_and_the_models(found, model):
    methods = ["radar points", "splat", model]
    assert [(r["frame"], r["truth"], r["method"]) for r in found.rows] == [
        (frame, truth, method)
        for frame in (0, 1) for method in methods for truth in ("LiDAR", WHOLE)
    ]  # fmt: skip
    shown = found.describe()
    assert shown["radar"] == SENT and shown["frames"] == 2
    assert [line["method"] for line in shown["against the LiDAR"]] == methods
    for named in found.clouds.values():
        assert [*named] == [*methods, "LiDAR"]


def f_score(found, truth):
    apart = np.linalg.norm(found[:, None] - truth[None], axis=-1) <= 0.2
    precision, recall = apart.any(1).mean(), apart.any(0).mean()
    return 2 * precision * recall / (precision + recall)


def test_the_radars_points_in_view_score_as_by_hand(found, walk):
    recording = open_recording(walk)
    prepared, *_ = prepare_frame(recording, 1, 1, PREPARED)
    truths = {
        "LiDAR": prepared.lidar_xyz,
        WHOLE: lidar_in_view(recording, prepared, PREPARED.lidar),
    }
    sent = recording.frames[1].xyz[len(AWAY) :]  # all others are in view
    for row in found.rows:
        if (row["frame"], row["method"]) == (1, "radar points"):
            truth = truths[row["truth"]]
            assert row["points"] == len(sent) == sum(SIZES.values())
            assert row["truth_points"] == len(truth)
            assert row["f_score_0.2"] == pytest.approx(f_score(sent, truth), abs=1e-6)
    cloud = found.clouds["walk", "walk", 1]["radar points"]
    np.testing.assert_array_equal(cloud, sent)


def test_the_notes_are_about_points(found, model):
    notes = " ".join(found.notes)
    assert "walk: 1 frames dropped, the radar sent no points" in notes
    assert "CFAR" not in notes and f"{model}: the model was trained on the" in notes
    assert "26% of the points are out of the model's view" in notes  # AWAY, 25 of 97


def test_records_of_points_score_as_the_recording(found, walk, model, tmp_path):
    prepare(walk, tmp_path / "r", PREPARED, workers=1, splits={"walk": "validation"})
    again = score(tmp_path / "r", models=[model])
    rows = {(r["frame"], r["method"]): r for r in found.rows if r["truth"] == "LiDAR"}
    assert len(again.rows) == len(rows) == 6
    for row in again.rows:
        same = rows[row["frame"], row["method"]]
        assert row["points"] == pytest.approx(same["points"], abs=1)
        assert row["f_score_0.2"] == pytest.approx(same["f_score_0.2"], abs=1e-3)


def test_models_of_samples_are_refused(walk, tmp_path):
    save_model(tmp_path / "plane", tiny_polar_model())
    with pytest.raises(UsageError, match="sees a radar's samples, not its points"):
        score(walk, models=[tmp_path / "plane"])


def test_splat_is_many_points_around_those_of_the_radar(found):
    for named in found.clouds.values():
        radar, splat = (named[name][:, :3] for name in ("radar points", "splat"))
        assert len(splat) > 3 * len(radar)
        apart = np.linalg.norm(splat[:, None] - radar[None], axis=-1).min(1)
        assert 0.05 < np.median(apart) < 0.5


def test_in_a_view_of_60_m_points_are_right_within_1_m(walk, tmp_path):
    fine = dataclasses.replace(SPEC.grid.fine, max_range_m=60.0)
    coarse = dataclasses.replace(SPEC.grid.coarse, max_range_m=60.0)
    folder = tmp_path / "wide"
    save_model(folder, tiny_model(method="regression", coarse=coarse, fine=fine))
    found = score(walk, models=[str(folder)])
    (line, *_) = (shown := found.describe())["against the LiDAR"]
    assert line["method"] == "radar points" and shown["by distance"][0]["F 1 m (%)"]
    prepared = PrepareSpec(lidar=LidarSpec(**VIEW | {"max_range_m": 60.0}))
    scores, distances = [], []
    for frame in (0, 1):
        record, *_ = prepare_frame(open_recording(walk), frame, frame, prepared)
        radar = np.asarray(record.radar.xyz)[np.asarray(record.radar.valid)]
        radar = radar[in_view(radar, fine)]
        scores.append(f_score(radar / 5, record.lidar_xyz / 5))
        apart = np.linalg.norm(radar[:, None] - record.lidar_xyz[None], axis=-1)
        distances.append(apart.min(0).mean() + apart.min(1).mean())
    assert line["F 1 m (%)"] == pytest.approx(100 * np.mean(scores), rel=1e-5)
    assert line["CD (m)"] == pytest.approx(np.mean(distances), rel=1e-5)
    report = found.write(tmp_path / "scores")
    about = (
        "The view is 5 times as large as usual, and so are the distances of F-scores"
    )
    assert about in report.read_text()
