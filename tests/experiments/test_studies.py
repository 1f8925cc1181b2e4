"""Studies of projection, solvers and detectors: survival, counts, tables."""

import csv

import jax
import numpy as np
import pytest
from PIL import Image

from experiments.studies import detectors, projection, robustness, solvers
from jradar.diffusion import SOLVERS, NoiseSpec, sample
from jradar.evaluation import read_scores
from jradar.range_image import ImageSpec, pixel_directions
from jradar.simulation import sets


def test_points_at_the_centres_of_pixels_all_survive():
    image = ImageSpec(8, 16)
    xyz = (5.0 * pixel_directions(image)).reshape(-1, 3).astype(np.float32)
    before, after = projection.round_trip(xyz, image, num_slices=4)
    assert len(before) == len(after) == 128
    np.testing.assert_allclose(after[np.lexsort(after.T)], xyz[np.lexsort(xyz.T)],
                               atol=1e-5)  # fmt: skip


def test_slices_keep_what_stands_behind():
    image = ImageSpec(8, 16, max_range_m=12.0)
    ray = pixel_directions(image)[3, 4]
    outside = -ray
    xyz = np.stack([2 * ray, 2.5 * ray, 9 * ray, outside]).astype(np.float32)
    for num_slices, distances in ((1, [2]), (2, [2, 9]), (24, [2, 2.5, 9])):
        before, after = projection.round_trip(xyz, image, num_slices=num_slices)
        assert len(before) == 3
        found = np.sort(np.linalg.norm(after, axis=-1))
        np.testing.assert_allclose(found, distances, rtol=1e-6)


def test_larger_images_and_more_slices_lose_less(
    records, tmp_path, monkeypatch, capsys
):
    sizes = {"LiDAR": ((8, 32), (32, 128)), "radar": ((8, 8), (32, 32))}
    monkeypatch.setattr(projection, "SIZES", sizes)
    monkeypatch.setattr(projection, "SLICES", (1, 4))
    assert projection.main([str(records), "-o", str(tmp_path), "--frames", "2"]) == 0
    assert "| LiDAR | 32x128 | 4 |" in capsys.readouterr().out
    rows = [*csv.DictReader((tmp_path / "table.csv").open())]
    assert len(rows) == 8 and {row["frames"] for row in rows} == {"2"}
    by = {(r["cloud"], r["size"], r["slices"]): float(r["kept"]) for r in rows}
    for cloud, (small, large) in sizes.items():
        small, large = (f"{h}x{w}" for h, w in (small, large))
        assert by[cloud, small, "1"] < by[cloud, large, "1"] <= by[cloud, large, "4"]
        assert by[cloud, large, "4"] <= 1
    assert min(Image.open(tmp_path / "projection.png").size) > 300


@pytest.mark.parametrize("solver", solvers.SHOWN)
@pytest.mark.parametrize("evaluations", [3, 5])
def test_a_solver_evaluates_the_network_as_often_as_planned(solver, evaluations):
    count = 0

    def denoise(x, sigma):
        nonlocal count
        count += 1
        return 0 * x

    # Without jit, since a compiled scan calls the function only once.
    with jax.disable_jit():
        sample(
            jax.random.key(0),
            denoise,
            (1, 2, 2, 1),
            noise=NoiseSpec(),
            solver=SOLVERS[solver],
            steps=solvers.steps_of(SOLVERS[solver], evaluations),
        )
    assert count == evaluations


def test_curves_run_over_evaluations():
    means = [
        {"method": f"{solver} {n}", "chamfer": 1 / n, "f_score_0.2": 0.1 * n}
        for solver in ("heun", "euler")
        for n in (1, 3)
    ]
    found = solvers.curves(means)
    assert found["chamfer"]["euler"] == [(1, 1.0), (3, pytest.approx(1 / 3))]
    assert found["f_score_0.2"]["heun"][1] == (3, pytest.approx(0.3))


def test_detectors_are_scored_by_a_command(records, tmp_path, capsys):
    assert detectors.main([str(records), "-o", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "false-alarm rates" in out and "| OS-CFAR |" in out
    assert (tmp_path / "evaluation" / "report.html").is_file()
    assert detectors.main([str(tmp_path / "nowhere"), "-o", str(tmp_path)]) == 2
    assert "nowhere" in capsys.readouterr().err


def test_the_table_of_shifts_has_means_and_the_area_of_the_warning():
    def row(shift, f_score, layout):
        scores = {"chamfer": 1.0, "modified_hausdorff": 0.5, "f_score_0.2": f_score}
        scores |= {"f_score_0.1": 0.0, "f_score_0.5": 0.0, "milliseconds": 1.0}
        place = {"scene": shift, "sequence": f"{shift} {layout}", "frame": 0}
        return (
            place
            | scores
            | {"truth": "LiDAR", "method": "ours", "points": 9}
            | {"truth_points": 9}
        )

    scores = [row("clean", 0.8, 0), row("clean", 0.6, 1)]
    scores += [row("noise", 0.3, 0), row("noise", 0.5, 1), row("tilt", 0.2, 0)]
    doubts = {
        ("ours", "clean"): np.array([[1.0, 0.3, 0.8], [2.0, 0.6, 0.7]]),
        ("ours", "noise"): np.array([[1.5, 0.5, 0.6], [3.0, 1.0, 0.75]]),
        ("ours", "tilt"): np.array([[9.0, 0.5, 0.4]]),
    }
    table = robustness.shifts_table(scores, doubts)
    assert "| noise | 1.00 / 40.0" in table and "| clean | 1.00 / 70.0" in table
    assert "| **mean over shifts** | **1.00 / 30.0** |  |" in table  # without clean
    assert "| 50, 0 / 0.75 / 0.75 |" in table  # 3 of 4 pairs of each are in order
    assert "| 0, 100 / 1.00 / 1.00 |" in table  # warned for its confidence


def test_every_shift_is_a_row_of_one_table(records, tmp_path, monkeypatch, capsys):
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    one = robustness.set_sequences("jradar-sim-2-robust/clean")[:1]
    for module in (robustness, sets):
        monkeypatch.setattr(module, "set_sequences", lambda name: one)
    shifts = ["--shift", "clean", "--shift", "standing-still"]
    command = ["-o", str(tmp_path), "--rates", str(records), *shifts]
    assert robustness.main(command) == 0
    rows = read_scores(tmp_path / "evaluation" / "frames.jsonl")
    assert {row["scene"] for row in rows} == {"clean", "standing-still"}
    assert {row["method"] for row in rows} == {"OS-CFAR"}
    table = (tmp_path / "evaluation" / "table.md").read_text()
    assert "standing-still" in table
    shifts = (tmp_path / "evaluation" / "shifts.md").read_text()
    assert "| **mean over shifts** |" in shifts
    assert robustness.main(command) == 0  # from the records of before
    assert read_scores(tmp_path / "evaluation" / "frames.jsonl")[0]["frame"] == 0
