"""Options: usage errors, help without JAX, and defaults equal to the library's."""

import argparse
import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from jradar import motion, simulation
from jradar.cli import main
from jradar.cli.groups import CLOUD_FORMATS, DEVICES
from jradar.cli.options import FAMILIES, ROTATIONS, SETS, parser
from jradar.cli.simulating import SCENE_FRAMES
from jradar.radar import DETECTORS, PointSpec
from jradar.radar.devices import BOARDS
from jradar.recordings import CLOUD_WRITERS
from jradar.simulation.sets import FRAMES

BIG = str(10**30)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: COMMAND"),
        (["info"], "required: PATH"),
        (["inform", "x.npy"], "invalid choice: 'inform'"),
        (["points", "x.npy"], "required: -o"),
        (["points", "x", "-o", "y", "--factor", "0"], "expected a number above 0"),
        (["points", "x", "-o", "y", "--capacity", "-1"], "expected 0 to"),
        (["points", "x", "-o", "y", "--guard", "2"], "expected D,R"),
        (["points", "x", "-o", "y", "--train", "4,99"], "expected 0 to 32"),
        (["points", "x", "-o", "y", "--max-range", "nan"], "expected a number above 0"),
        (["points", "x", "-o", "y", "--frame", "one"], "invalid int value"),
        (["points", "x", "-o", "y", "--format", "las"], "invalid choice: 'las'"),
        (["enhance", "x", "-o", "y", "--seed", "-1"], "expected 0 to 4294967295"),
        (["simulate", "-o", "y", "--scene", "lab", "--seed", BIG], "expected 0 to"),
        (["enhance", "x", "-o", "y", "--draws", BIG], "expected 1 to 64"),
        (["enhance", "x", "-o", "y", "--steps", "1001"], "expected 1 to 1000"),
        (["points", "x", "-o", "y", "--max-rnage=3"], "did you mean --max-range?"),
        (["view", "x", "--json", "stray"], "unrecognized arguments: stray"),
        (["points", "x", "-o", "y", "--device", "xwr1642"], "awr1642"),
        (["prepare", "x", "-o", "y", "--frames", "3"], "expected A:B"),
        (["prepare", "x", "-o", "y", "--frames", "5:2"], "holds no frame"),
        (["prepare", "x", "-o", "y", "--workers", "0"], "expected 1 to"),
        (["simulate", "-o", "y"], "--scene --set is required"),
        (["simulate", "-o", "y", "--set", SETS[0], "--scene", "lab"], "not allowed"),
    ],
)
def test_a_usage_error_is_code_2_and_names_the_mend(arguments, message, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    error = capsys.readouterr().err
    assert stop.value.code == 2 and message in error
    assert error.startswith("jradar") and error.count("\n") == 1


def test_help_names_files_and_answers_without_jax():
    code = (
        "import sys; from jradar.cli import main\n"
        "try: main(['points', '--help'])\n"
        "finally: print('jax' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0 and "adc_data.bin" in run.stdout
    assert run.stdout.endswith("False\n")


def test_choices_are_those_of_the_library():
    assert FAMILIES == tuple(simulation.FAMILIES)
    assert SETS == tuple(simulation.SETS)
    assert DEVICES == tuple(BOARDS)
    assert CLOUD_FORMATS == tuple(CLOUD_WRITERS)
    assert ROTATIONS == motion.ROTATIONS


def test_help_shows_the_defaults_of_the_library():
    (commands,) = parser()._subparsers._group_actions
    text = commands.choices["points"].format_help()
    assert all(name in text for name in DETECTORS)
    actions = {a.dest: a for a in commands.choices["simulate"]._actions}
    assert f"{SCENE_FRAMES} for a scene, {FRAMES} in a set" in actions["frames"].help
    actions = {a.dest: a for a in commands.choices["points"]._actions}
    for field in dataclasses.fields(PointSpec):
        action = actions[field.name]
        assert action.default is None and len(action.help) > 20
        if field.default is not None and not isinstance(field.default, bool):
            value = str(field.default).strip("()").replace(", ", ",")
            assert f"(default: {value})" in action.help


def test_an_option_that_no_radar_could_use_is_named(tmp_path, capsys):
    np.save(tmp_path / "x.npy", np.zeros(3))
    command = ["points", str(tmp_path / "x.npy"), "-o", str(tmp_path / "y")]
    for option, message in (
        (["--false-alarm-rate", "2"], "false_alarm_rate = 2.0, expected 0 < rate"),
        (["--capacity", "0"], "capacity = 0, expected 1 to 1,048,576"),
        (["--detector", "cfar"], "detector = 'cfar', expected one of"),
    ):
        assert main([*command, *option]) == 2
        assert message in capsys.readouterr().err


def test_every_option_has_a_help_text_and_a_description():
    (commands,) = parser()._subparsers._group_actions
    for name, command in commands.choices.items():
        assert command.description, name
        for action in command._actions:
            assert action.help and action.help != argparse.SUPPRESS, (name, action.dest)
