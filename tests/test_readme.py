"""The README: its Python example runs, its TOML example describes a radar."""

import re
from pathlib import Path

from jradar.radar import RadarSpec

README = (Path(__file__).parents[1] / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_python_example_runs_and_finds_its_target():
    (code,) = blocks("python")
    assert len(code.strip().splitlines()) <= 11  # ten lines and a blank one
    names = {}
    exec(code, names)
    x, y, z = names["cloud"].xyz[0]
    assert abs(x - 5) < 0.2 and abs(y - 1) < 0.2 and abs(z - 0.3) < 0.2
    assert names["cloud"].velocity[0] < -1 and (names["image"] > 0).any()


def test_toml_example_is_a_radar(tmp_path):
    (text,) = blocks("toml")
    path = tmp_path / "radar.toml"
    path.write_text(text)
    assert RadarSpec.from_toml(path).cube_shape == (2, 4, 128, 128)


def test_two_commands_do_all_the_set_up():
    section = README.split("## Run it")[1].split("\n## ")[0]
    commands = re.findall(r"```bash\n(.*)\n```", section)
    assert len(commands) == 2
    for command in commands:
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install")
