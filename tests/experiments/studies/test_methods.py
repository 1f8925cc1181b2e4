"""The study of methods: what it trains, and its tables of parts."""

import pytest

from experiments.studies import methods


def test_kinds_are_averaged_over_seeds():
    def row(kind, method, score):
        return {"scene": kind, "method": method, "f_score_0.2": score}

    rows = [
        row("hall", "one pass, seed 0", 0.5),
        row("hall", "one pass, seed 1", 0.7),
        row("hall", "diffusion, seed 0: Heun 18", 0.25),
        row("room", "one pass, seed 0", 0.2),
        row("room", "diffusion, seed 0: Heun 18", 0.35),
        row("room", "one pass, seed 0", float("nan")),  # an empty truth
    ]
    table = methods.parts_table(rows, "scene")
    assert "| scene | one pass | diffusion: Heun 18 |" in table
    assert "| hall | 60.0 | 25.0 |" in table
    assert "| **mean** | **40.0** | **30.0** |" in table


@pytest.mark.slow
def test_methods_are_trained_once_and_share_one_table(records, tmp_path, capsys):
    chosen = ["--method", "rpdnet", "--method", "regression", "--steps", "1"]
    command = ["--data", str(records), "-o", str(tmp_path), *chosen]
    assert methods.main(command) == 0
    table = (tmp_path / "evaluation" / "table.md").read_text()
    for name in ("OS-CFAR", "splat", "rpdnet, seed 0", "regression, seed 0"):
        assert name in table
    assert "**mean**" in (tmp_path / "kinds.md").read_text()
    assert "| 2 to 4 m | " in (tmp_path / "distances.md").read_text()
    weights = tmp_path / "regression" / "seed_0" / "model" / "weights.safetensors"
    before = weights.stat().st_mtime_ns
    assert methods.main(command) == 0
    assert weights.stat().st_mtime_ns == before
    assert methods.main([*command, "--steps", "2"]) == 2  # other runs of the folder
    assert "was started with another config" in capsys.readouterr().err
    assert weights.stat().st_mtime_ns == before
