"""Type checkers see through decorators: wrong lines are errors, right ones are not."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

import jradar

ROOT = Path(jradar.__file__).parents[1]
LINES = """
import jax
import numpy as np

import jradar
from jradar import metrics, radar, range_image

key, frame = jax.random.key(0), np.zeros((3, 4, 128, 128), np.complex64)
unit = jradar.Radar(jradar.RadarSpec.awr1843())
points = radar.radar_points(frame, unit, points=radar.PointSpec(detector="ca"))
cloud = jradar.enhance_points(key, points, jradar.load_model("jradar-sim"), draws=8)
cloud.within(max_range_m=8.0).save("cloud.ply")
metrics.compare(points, cloud).f_score

points.xyzz  # wrong
jradar.enhance(1, 2)  # wrong
jradar.load_model("jradar-sim").weights  # wrong
radar.radar_points(frame, unit, detector="ca")  # wrong
radar.os_cfar(frame, rate=1e-3)  # wrong
points.within(max_range=8.0)  # wrong
range_image.project(points)  # wrong
metrics.compare(points, 3)  # wrong
"""


@pytest.mark.slow  # pyright fetches its own program when it first runs
def test_pyright_refuses_wrong_lines_and_accepts_right_ones(tmp_path):
    pytest.importorskip("pyright")
    (tmp_path / "user.py").write_text(LINES)
    options = {"extraPaths": [str(ROOT)], "reportPrivateImportUsage": False}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(options))
    command = ["pyright", "--pythonpath", sys.executable, "--outputjson"]
    run = subprocess.run(
        [sys.executable, "-m", *command], cwd=tmp_path, capture_output=True, text=True
    )
    problems = json.loads(run.stdout)["generalDiagnostics"]
    errors = [found for found in problems if found["severity"] == "error"]
    wrong = [n for n, line in enumerate(LINES.splitlines()) if "# wrong" in line]
    assert len(wrong) == 8
    assert [error["range"]["start"]["line"] for error in errors] == wrong, errors
