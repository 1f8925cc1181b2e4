"""The README's network of one's own becomes a config that trains and is compared."""

import re
from pathlib import Path

import numpy as np
import pytest

from experiments import main
from jradar.diffusion import NETWORKS
from jradar.evaluation import read_scores
from jradar.model import load_model

README = Path(main.__file__).with_name("README.md")


@pytest.fixture
def config(tmp_path):
    """The README's file, as it stands there."""
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), re.DOTALL)
    (text,) = (block for block in blocks if "def get_config" in block)
    (tmp_path / "own.py").write_text(text)
    yield tmp_path / "own.py"
    NETWORKS.pop("small", None)


@pytest.mark.slow
def test_the_readmes_config_trains_and_is_compared(config, records, tmp_path):
    command = ["main", f"--config={config}", f"--workdir={tmp_path / 'run'}"]
    command += [f"--config.data.path={records}", "--config.train.steps=4"]
    command += ["--config.sampling.draws=1", "--config.sampling.steps=2"]
    assert main.main(command) == 0
    model = load_model(tmp_path / "run")
    assert type(model.spec.network) is NETWORKS["small"]
    assert model.spec.network.channels == 24
    assert model.card.purpose == "a small network of our own"
    rows = read_scores(tmp_path / "run" / "evaluation" / "frames.jsonl")
    assert {"OS-CFAR", "splat", "jradar, Heun 2"} <= {row["method"] for row in rows}
    assert np.isfinite(rows[0]["chamfer"])
