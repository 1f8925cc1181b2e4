"""The page of one's own rig, jradar/data/README.md, runs as it stands."""

import os
import re
import sys
from pathlib import Path

import pytest

from tests.programs import ROOT, pasted

PAGE = (ROOT / "jradar" / "data" / "README.md").read_text()


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_page_runs_as_it_stands(tmp_path):
    """With the environment that runs this test; see there for what is fine-tuned."""
    for module in ("embreex", "rosbags"):
        pytest.importorskip(module)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    del environment["XLA_FLAGS"]  # programs that compile quickly would train slowly
    lines = re.findall(r"```bash\n(.*?)```", PAGE, re.DOTALL)
    command = 'jradar() { python -m jradar "$@"; }'
    shown = pasted([command, *lines], tmp_path, environment)
    rows = re.findall(r"^ +(jradar-sim|mine) +[0-9.]+ +([0-9.]+) ", shown, re.M)
    shipped, own = (dict(rows[::-1])[name] for name in ("jradar-sim", "mine"))
    assert float(own) >= float(shipped) - 2
    assert (tmp_path / "scores" / "evaluation" / "report.html").is_file()
