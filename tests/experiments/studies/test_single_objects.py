"""The study of single objects: what a cloud shows of them."""

import numpy as np
import pytest

from experiments.studies import single_objects
from experiments.studies.single_objects import Seen, seen_of


def wall(x, wide, high, y=0.0):
    """Points of an upright rectangle across the view, 5 cm apart."""
    ys, zs = np.arange(-wide / 2, wide / 2, 0.05), np.arange(-high / 2, high / 2, 0.05)
    y_all, z_all = np.meshgrid(ys + y, zs)
    return np.stack([np.full(y_all.size, x), y_all.ravel(), z_all.ravel()], -1)


def test_a_cloud_is_measured_where_the_object_is_and_counted_elsewhere():
    truth, away = wall(5.0, 1.0, 2.0), wall(8.0, 3.0, 1.0)
    found = np.concatenate([wall(5.2, 0.6, 1.2), away])
    seen = seen_of(found, truth)
    assert seen.found == 1 and seen.in_the_air == len(away)
    assert seen.distance_m == pytest.approx(5.2, abs=0.01)
    assert seen.width_m == pytest.approx(0.9 * 0.6, abs=0.06)
    assert seen.height_m == pytest.approx(0.9 * 1.2, abs=0.06)
    assert seen_of(truth, truth).distance_m == pytest.approx(5.0, abs=0.01)
    nothing = seen_of(away, truth)
    assert (nothing.found, nothing.in_the_air) == (0, len(away))
    assert seen_of(found[:0], truth)[::4] == (0.0, 0.0)


def test_an_object_aside_is_measured_along_and_across_its_direction():
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    truth = wall(5.0, 1.0, 2.0)
    np.testing.assert_allclose(
        seen_of(truth @ turn.T, truth @ turn.T), seen_of(truth, truth), atol=1e-9
    )


def test_the_table_has_a_row_for_each_method_beside_the_lidars(tmp_path, capsys):
    true, off = Seen(1, 4.0, 0.5, 2.0, 0), Seen(1, 4.3, 0.7, 1.0, 10)
    missed = Seen(0, np.nan, np.nan, np.nan, 30)
    rows = {("pillar", 4.0, "ours"): [off, missed], ("pillar", 4.0, "LiDAR"): [true]}
    single_objects.write_results(tmp_path, rows)
    lines = (tmp_path / "objects.md").read_text().splitlines()
    assert lines[2] == "| pillar | 4 | LiDAR | 1 of 1 | 0.00 | 0.50 | 2.00 | 0 |"
    assert lines[3] == "| pillar | 4 | ours | 1 of 2 | 0.30 | 0.70 | 1.00 | 20 |"


@pytest.mark.slow
def test_the_simulated_objects_are_seen_by_the_lidar(tmp_path, monkeypatch, capsys):
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    monkeypatch.setattr(single_objects, "DISTANCES_M", (4.0,))
    monkeypatch.setattr(single_objects, "BEARINGS", (0.0,))
    command = ["-o", str(tmp_path), "--model", "jradar-sim"]
    assert single_objects.main(command) == 0
    lines = (tmp_path / "objects.md").read_text().splitlines()[2:]
    assert len(lines) == 8
    sizes = {
        cells[1]: (float(cells[6]), float(cells[7]))
        for cells in ([cell.strip() for cell in line.split("|")] for line in lines)
        if cells[3] == "LiDAR"
    }
    assert 0.3 < sizes["pillar"][0] < 0.5 and sizes["pillar"][1] > 1.5
    assert sizes["beam"][0] > 2.4 and sizes["beam"][1] < 0.4
    assert sizes["table"][0] > 1.0 and sizes["trihedral"][1] < 0.3
