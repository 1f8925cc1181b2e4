"""The task `maps`: splits, and a short run from packed maps to a table."""

import numpy as np
import pytest

from experiments import main, maps
from experiments.configs import maps as recipe
from jradar.errors import UsageError
from jradar.evaluation import reliability
from jradar.model import load_model
from tests.mapping.test_maps import room, save_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    for seed, name in enumerate(("hall_run0", "hall_run1", "mine_run1", "mine_run2")):
        save_run(folder / f"{name}.npz", room(np.random.default_rng(seed)))
    return folder


def config(folder, **data):
    found = recipe.get_config()
    found.data.update(path=str(folder), validation=("mine_run2",), **data)
    return found


def names(splits):
    return {split: [run.name for run in runs] for split, runs in splits.items()}


def test_runs_are_split_and_the_published_test_is_never_trained_on(folder):
    assert names(maps.splits(config(folder))) == {
        "train": ["hall_run1", "mine_run1"],
        "confidence": ["mine_run2"],
        "validation": ["mine_run2"],
        "test": ["hall_run0"],
    }


def test_without_runs_to_validate_all_but_the_published_test_train(folder):
    everything = config(folder)
    everything.data.validation = ()
    assert names(maps.splits(everything)) == {
        "train": ["hall_run1", "mine_run1", "mine_run2"],
        "confidence": [],
        "validation": [],
        "test": ["hall_run0"],
    }
    with pytest.raises(UsageError, match="no runs, expected one of .'train', 'test'."):
        maps.setup(everything, folder)


def test_an_environment_left_out_neither_trains_nor_fits_the_confidence(folder):
    assert names(maps.splits(config(folder, without="hall"))) == {
        "train": ["mine_run1"],
        "confidence": ["mine_run2"],
        "validation": ["hall_run1"],
        "test": ["hall_run0"],
    }
    with pytest.raises(UsageError, match="no run to fit the confidence on without min"):
        maps.splits(config(folder, without="mine"))


def test_unknown_runs_and_environments_are_named(folder):
    with pytest.raises(UsageError, match="'attic', expected one of .'hall', 'mine'"):
        maps.splits(config(folder, without="attic"))
    wrong = config(folder)
    wrong.data.validation = ("mine_run9",)
    with pytest.raises(UsageError, match="mine_run9, which is not in the data"):
        maps.splits(wrong)
    wrong.data.path = ""
    with pytest.raises(UsageError, match="no maps: pass the folder"):
        maps.check(wrong)


def test_the_calibration_error_is_that_of_all_voxels_of_a_group():
    """Half of the voxels are as right as they say, half 20 % less."""
    first = reliability(np.full(10, 0.7), np.arange(10) < 7)
    second = reliability(np.full(10, 0.85), np.arange(10) < 6.5)
    zeros = {"environment": "mine"} | dict.fromkeys(maps.SCORES, 0)
    rows = [zeros | {"bins": np.stack(bins).tolist()} for bins in (first, second)]
    assert "| 7.5 |" in maps.summary(rows)


@pytest.mark.slow
@pytest.mark.parametrize("kept", ["('mine_run2',)", "()"])
def test_a_short_run_trains_saves_and_scores(folder, tmp_path, capsys, kept):
    options = {"data.path": folder, "data.validation": kept}
    options |= {"map.heights": 16, "map.tile": 32, "network.channels": 8}
    options |= {"network.multipliers": "(1,)", "network.condition_channels": 8}
    options |= {"train.steps": 4, "train.batch_size": 2, "train.evaluate_every": 2}
    options |= {"evaluation.split": "validation" if "mine" in kept else "test"}
    words = [f"--config.{name}={value}" for name, value in options.items()]
    file = f"--config={recipe.__file__}"
    workdir = tmp_path / "run"
    command = ["main", file, f"--workdir={workdir}", *words]
    assert main.main(command) == 0
    table = (workdir / "evaluation" / "table.md").read_text()
    scored = "mine" if "mine" in kept else "hall"
    assert f"| {scored} " in table and table in capsys.readouterr().out
    drawn = [path.stem for path in (workdir / "evaluation").glob("*.png")]
    assert drawn == ["mine_run2" if "mine" in kept else "hall_run0"]
    model = load_model(workdir)
    trained = "4 patches of 2 runs" if "mine" in kept else "6 patches of 3 runs"
    assert trained in model.card.trained_on
    assert main.main([*command, "--mode=eval", "--config.evaluation.split=test"]) == 0
    assert "| hall " in (workdir / "evaluation" / "table.md").read_text()
