"""Notebooks run from top to bottom, and find what they promise."""

import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "experiments" / "notebooks"


def run(name, folder):
    """Execute a notebook in a folder; returns all that it shows as text."""
    client = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    resources = {"metadata": {"path": str(folder)}}
    client.NotebookClient(notebook, timeout=600, resources=resources).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    pictures = sum("image/png" in out.get("data", {}) for out in outputs)
    texts = [out.get("text") or out["data"]["text/plain"] for out in outputs]
    return "\n".join(texts), pictures


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


def test_notebooks_are_stored_without_results():
    for path in FOLDER.glob("*.ipynb"):
        cells = json.loads(path.read_text())["cells"]
        assert len(cells) > 5 and not any(cell.get("outputs") for cell in cells)
