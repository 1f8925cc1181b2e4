"""Options: usage errors, help without JAX, and defaults equal to the library's."""

import argparse
import dataclasses
import os
import subprocess
import sys

import pytest

from jradar.cli.options import parser
from jradar.radar import DETECTORS, PointSpec
from jradar.simulation.plan import FRAMES, SCENE_FRAMES
from tests.programs import finished

BIG = str(10**30)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "required: COMMAND"),
        (["info"], "required: PATH"),
        (["enhnace", "x.npy"], "did you mean enhance?"),
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
        (["-q", "info", "x"], "arguments: -q: it stands after the command"),
        (["info", "x", "--level"], "arguments: --level: it stands after calibrate"),
        (["points", "x", "-o", "y", "--max-rnage=3"], "did you mean --max-range?"),
        (["view", "x", "--json", "stray"], "unrecognized arguments: stray"),
        (["points", "x", "-o", "y", "--device", "xwr1642"], "did you mean awr1642?"),
        (["calibrate", "x", "-o", "y", "--reflector", "3,9"], "or M,AZ,EL such as"),
        (["replay", "x", "--reorder", "1001"], "expected 0 to 1000"),
        (["prepare", "x", "-o", "y", "--frames", "3"], "expected A:B"),
        (["prepare", "x", "-o", "y", "--frames", "5:2"], "holds no frame"),
        (["prepare", "x", "-o", "y", "--workers", "0"], "expected 1 to"),
        (["simulate", "-o", "y"], "--scene --set is required"),
        (
            ["simulate", "-o", "y", "--set", "jradar-sim-1", "--scene", "lab"],
            "not allowed",
        ),
    ],
)
def test_a_usage_error_is_code_2_and_names_the_mend(arguments, message, refused):
    assert message in refused(*arguments)


def test_help_and_usage_errors_answer_without_jax():
    code = """
import contextlib, sys
from jradar.cli import main
for words in ("--help", "points --help", "enhnace x", "points x", "live --drwas 1"):
    with contextlib.suppress(SystemExit):
        main(words.split())
print("jax" in sys.modules, "numpy" in sys.modules)
"""
    run = finished(code)
    assert run.returncode == 0 and "adc_data.bin" in run.stdout
    assert run.stdout.endswith("False False\n")
    assert "did you mean enhance?" in run.stderr and "--draws?" in run.stderr


def test_a_shell_completes_commands_and_options(tmp_path):
    pytest.importorskip("argcomplete")
    for line, expected in (("jradar enh", "enhance"), ("jradar live --dr", "--draws")):
        found = tmp_path / "found"
        subprocess.run(
            [sys.executable, "-m", "jradar"],
            env=os.environ
            | {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line))}
            | {"_ARGCOMPLETE_STDOUT_FILENAME": str(found)},
        )
        assert found.read_text().split() == [expected]


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


def test_an_option_that_no_radar_could_use_is_named(small_cube, tmp_path, refused):
    for option, message in (
        (["--false-alarm-rate", "2"], "false_alarm_rate = 2.0, expected 0 < rate"),
        (["--capacity", "0"], "capacity = 0, expected 1 to 1,048,576"),
        (["--detector", "cfar"], "detector = 'cfar', expected one of"),
        (["--min-range", "5", "--max-range", "5"], "--min-range 5 --max-range 5, expe"),
        (["--background", "5:9"], "no background in frames 5 and later"),
        (["--frame", "1"], "has frames 0 to 0"),
        (["--frame", "-1"], "has frames 0 to 0"),
    ):
        assert message in refused("points", small_cube, "-o", tmp_path / "y", *option)
    assert not (tmp_path / "y").exists()


def test_every_option_has_a_help_text_and_a_description():
    (commands,) = parser()._subparsers._group_actions
    for name, command in commands.choices.items():
        assert command.description, name
        for action in command._actions:
            assert action.help and action.help != argparse.SUPPRESS, (name, action.dest)
