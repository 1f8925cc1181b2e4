"""Options: usage errors, help without JAX, and defaults equal to the library's."""

import argparse
import subprocess
import sys

import pytest

from jradar import simulation
from jradar.cli import main
from jradar.cli.options import DEVICES, FAMILIES, SETS, parser
from jradar.cli.simulating import SCENE_FRAMES
from jradar.radar import DETECTORS, PointSpec
from jradar.radar.devices import BOARDS
from jradar.simulation.sets import FRAMES


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: COMMAND"),
        (["info"], "required: PATH"),
        (["inform", "x.npy"], "invalid choice: 'inform'"),
        (["points", "x.npy"], "required: -o"),
        (["points", "x", "-o", "y", "--false-alarm-rate", "2"], "expected more than 0"),
        (["points", "x", "-o", "y", "--capacity", "0"], "expected 1 or more"),
        (["points", "x", "-o", "y", "--device", "xwr1642"], "awr1642"),
        (["prepare", "x", "-o", "y", "--frames", "3"], "expected A:B"),
        (["prepare", "x", "-o", "y", "--frames", "5:2"], "holds no frame"),
        (["prepare", "x", "-o", "y", "--workers", "0"], "expected 1 or more"),
        (["simulate", "-o", "y"], "--scene --set is required"),
        (["simulate", "-o", "y", "--set", "jradar-sim"], "jradar-sim-1-mini"),
        (["simulate", "-o", "y", "--set", SETS[0], "--scene", "lab"], "not allowed"),
    ],
)
def test_a_usage_error_is_code_2_and_names_the_mend(arguments, message, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2 and message in capsys.readouterr().err


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


def test_help_shows_the_defaults_of_the_library():
    (commands,) = parser()._subparsers._group_actions
    text = commands.choices["points"].format_help()
    assert all(f"{name} (" in text for name in DETECTORS)
    actions = {a.dest: a for a in commands.choices["simulate"]._actions}
    assert f"{SCENE_FRAMES} for a scene, {FRAMES} in a set" in actions["frames"].help
    actions = {a.dest: a for a in commands.choices["points"]._actions}
    spec = PointSpec()
    for name in ("detector", "false_alarm_rate", "capacity"):
        assert f"(default: {getattr(spec, name)})" in actions[name].help
        assert actions[name].default is None


def test_every_option_has_a_help_text_and_a_description():
    (commands,) = parser()._subparsers._group_actions
    for name, command in commands.choices.items():
        assert command.description, name
        for action in command._actions:
            assert action.help and action.help != argparse.SUPPRESS, (name, action.dest)
