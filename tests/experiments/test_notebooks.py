"""Notebooks run from top to bottom, and store what they find and show."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "experiments" / "notebooks"
LARGEST = 200_000  # bytes


def outputs(notebook):
    """What each cell shows, by kind, and all of it as text."""
    shown = [
        [out.get("data", {"text/plain": out.get("text")}) for out in cell["outputs"]]
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
    ]
    texts = [data["text/plain"] for cell in shown for data in cell]
    return [[sorted(data) for data in cell] for cell in shown], "\n".join(texts)


def without_numbers(text):
    """A text, whose numbers may differ from machine to machine."""
    return re.sub(r"-?\d[\d.,e+-]*|\s+|0x[0-9a-f]+", " # ", text)


def run(name, folder):
    """Execute a notebook in a folder; returns all that it shows as text."""
    pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    from experiments.notebooks.store import executed

    path = FOLDER / f"{name}.ipynb"
    kinds, text = outputs(executed(path, folder))
    stored, before = outputs(nbformat.read(path, as_version=4))
    again = "run experiments/notebooks/store.py"
    assert kinds == stored and without_numbers(text) == without_numbers(before), again
    return text, sum(kind.count("image/png") for cell in kinds for kind in cell)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_kernels_find_the_targets_at_the_promised_rate(tmp_path):
    text, pictures = run("kernels", tmp_path)
    assert pictures == 2
    assert float(re.search(r"found ([0-9.]+) %", text)[1]) == pytest.approx(1, abs=0.2)
    assert "8.0 m ahead, 2.0 m to the left, 0.0 m/s" in text
    assert "12.0 m ahead, -4.0 m to the left, 1.5 m/s" in text


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_capture_becomes_a_cloud_near_the_lidars(tmp_path):
    text, pictures = run("cloud", tmp_path)
    assert pictures == 3
    assert float(re.search(r"Chamfer distance ([0-9.]+) m", text)[1]) < 1.5


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_model_is_trained_and_compared(tmp_path):
    text, pictures = run("training", tmp_path)
    assert pictures == 1
    scores = dict(re.findall(r"(\S+)  F-score ([0-9.]+) %", text))
    names = {name.rpartition("/")[2]: float(score) for name, score in scores.items()}
    assert {"OS-CFAR", "splat", "jradar-sim", "mine"} == names.keys()
    assert names["OS-CFAR"] < min(names["jradar-sim"], names["mine"])


def test_notebooks_are_small_and_show_what_they_found():
    paths = sorted(FOLDER.glob("*.ipynb"))
    assert [path.stem for path in paths] == ["cloud", "kernels", "training"]
    nbformat = pytest.importorskip("nbformat")
    for path in paths:
        assert path.stat().st_size < LARGEST
        kinds, text = outputs(nbformat.read(path, as_version=4))
        assert any("image/png" in kind for cell in kinds for kind in cell)
        assert len(text) > 50 and "Error" not in text
