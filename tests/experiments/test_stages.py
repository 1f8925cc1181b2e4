"""Stages: each starts from those before, the result is their mean, and runs resume."""

import json
import shutil

import jax
import numpy as np
import pytest

from experiments import enhance, main, stages
from experiments.configs import rpdnet
from jradar import load_model
from jradar.diffusion import read_params
from jradar.errors import UsageError
from tests.experiments.tiny_config import get_config as tiny_config

STAGES = (
    {"method": "regression", "noise": {"prediction": "clean"}, "train": {"steps": 2}},
    {"method": "regression", "noise": {"prediction": "clean"}, "train": {"steps": 3}},
)
CONFIG = """\
from tests.experiments.tiny_config import get_config as tiny_config

def get_config():
    config = tiny_config()
    config.stages, config.average = {stages}, (0.25, 0.75)
    return config
"""


def weights(folder):
    return read_params(folder / "model" / "weights.safetensors")


def test_one_command_trains_all_stages_and_resumes(
    records, tmp_path, capsys, monkeypatch
):
    # Scores and pictures of each stage are those of any run.
    monkeypatch.setattr(enhance, "validate", lambda *_, **__: {})
    file, workdir = tmp_path / "staged.py", tmp_path / "run"
    file.write_text(CONFIG.format(stages=STAGES))
    command = ["main", f"--config={file}", f"--config.data.path={records}"]
    command.append(f"--workdir={workdir}")
    assert main.main(command) == 0
    err = capsys.readouterr().err
    assert f"starting from {workdir}/stage_0/model/weights" in err
    assert load_model(workdir).card.steps_seen == 2 + 3
    card = json.loads((workdir / "model_card.json").read_text())
    assert card["steps"] == 5 and len(card["config"]["stages"]) == 2
    before, after = (weights(workdir / f"stage_{k}") for k in (0, 1))
    saved = weights(workdir)
    for one, other, mean in zip(
        *map(jax.tree.leaves, (before, after, saved)), strict=True
    ):
        np.testing.assert_allclose(mean, 0.25 * one + 0.75 * other, atol=2e-3)
    assert (workdir / "evaluation" / "table.md").is_file()
    assert not (workdir / "stage_1" / "evaluation").exists()

    shutil.rmtree(workdir / "stage_1")  # as if it had not begun
    shutil.rmtree(workdir / "model")
    monkeypatch.setattr(enhance, "evaluate", lambda *_: None)  # has been tested above
    done = (workdir / "stage_0" / "model_card.json").stat().st_mtime_ns
    assert main.main(command) == 0
    assert (workdir / "stage_0" / "model_card.json").stat().st_mtime_ns == done
    for mean, again in zip(
        *map(jax.tree.leaves, (saved, weights(workdir))), strict=True
    ):
        np.testing.assert_array_equal(mean, again)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stages": ({"train": {"stepps": 1}},)}, "unknown config key 'train.stepps'"),
        ({"stages": ({"train": {"steps": "x"}},)}, "config.stages: "),
        ({"stages": ({}, {"start": (1, 0)})}, r"start = \(1, 0\), expected 1 shares"),
        ({"stages": ({}, {}), "average": (0.5, 0.6)}, "expected 2 shares of 1 in all"),
    ],
)
def test_a_wrong_stage_is_named(changes, message, tmp_path):
    config = tiny_config()
    config.update(changes)
    with pytest.raises(UsageError, match=message):
        stages.stages_of(config, tmp_path)


def test_a_task_that_starts_from_nothing_has_no_stages(tmp_path):
    config = rpdnet.get_config()
    config.stages = ({},)
    with pytest.raises(UsageError, match="task 'rpdnet' has no stages"):
        stages.final_config(config, tmp_path)


def test_stages_that_change_no_data_share_the_records_of_the_run(tmp_path):
    config = tiny_config()
    config.stages = ({}, {"data": {"frames": 1}}, {"points": {"capacity": 256}})
    paths = [s.config.data.path for s in stages.stages_of(config, tmp_path)[:3]]
    assert paths == [str(tmp_path / "data" / "records"), "", ""]
