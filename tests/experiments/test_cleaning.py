"""The study of cleaning: what moved, and a row for each way to process a shift."""

import numpy as np
import pytest

from experiments.studies import cleaning, robustness
from jradar.simulation import sets


def test_what_moved_are_the_points_that_the_first_frame_lacks():
    wall = np.random.default_rng(0).uniform(0, 3, (500, 3))
    walker = np.tile([[5.0, 1.0, 0.0]], (cleaning.LEAST_POINTS, 1))
    clouds = {
        ("a", 0): wall,
        ("a", 5): np.concatenate([wall, walker]),
        ("b", 0): wall,
        ("b", 5): np.concatenate([wall, walker[1:]]),  # too few
        ("c", 5): wall,  # without a first frame
    }
    found = cleaning.moved(clouds)
    assert [*found] == [("a", 5)]
    np.testing.assert_array_equal(found["a", 5], walker)


def test_a_shift_has_a_row_for_each_kind_of_samples(tmp_path, monkeypatch, capsys):
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    known = robustness.set_sequences
    for module in (robustness, sets):
        monkeypatch.setattr(module, "set_sequences", lambda name: known(name)[:1])
    shifts = ["--shift", "strong-interference", "--shift", "standing-still"]
    assert cleaning.main(["-o", str(tmp_path), *shifts]) == 0
    text = (tmp_path / "cleaning.md").read_text()
    assert text in capsys.readouterr().out
    rows = [
        [cell.strip() for cell in line.strip("|\n ").split("|")]
        for line in text.splitlines()
        if "s" in line and "---" not in line
    ]
    noisy = {row[1]: row for row in rows if row[0] == "strong-interference"}
    assert float(noisy["excised"][4]) > float(noisy["as recorded"][4])
    everything = [row for row in rows if row[:2] == ["standing-still", "all"]]
    before, after = (float(row[5]) for row in everything)
    assert after < before  # a room stands still, too
