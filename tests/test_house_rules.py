"""House rules: floors, files, keys first, options by keyword, docstrings, laziness."""

import ast
import importlib
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import jradar

PACKAGE = Path(jradar.__file__).parent
FLOORS = {
    "errors": 0,
    "types": 1,
    "nearest": 1,
    "files": 1,
    "progress": 1,
    "results": 2,
    "radar": 2,
    "range_image": 2,
    "lidar": 2,
    "diffusion": 2,
    "metrics": 2,
    "recordings": 3,
    "model": 3,
    "motion": 4,
    "simulation": 4,
    "viz": 4,
    "baselines": 4,
    "calibration": 5,
    "session": 5,
    "data": 6,
    "training": 6,
    "evaluation": 6,
    "stream": 7,
    "export": 7,
    "cli": 8,
}
PURE = ("types", "nearest", "radar", "range_image", "lidar", "diffusion", "metrics")
READERS = (
    "diffusion/weights/files.py",
    "diffusion/weights/pretrained.py",
    "diffusion/perceptual.py",
)
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(module):
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_names(module):
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + f"{node.module}"
            yield from (
                "." * node.level + f"{node.module}.{alias.name}" for alias in node.names
            )


IMPORTS = [(m, name) for m in MODULES for name in imported_names(m)]


def public_functions():
    for room in FLOORS:
        if room == "cli":
            continue
        module = importlib.import_module(f"jradar.{room}")
        for name, value in vars(module).items():
            function = inspect.unwrap(value) if callable(value) else None
            home = getattr(function, "__module__", "") or ""
            if inspect.isfunction(function) and not name.startswith("_"):
                if home.startswith("jradar."):
                    yield f"{room}.{name}", function


def test_imports_come_from_the_own_room_or_a_lower_floor():
    wrong = []
    for module, name in IMPORTS:
        room = room_of(module)
        first, *rest = name.split(".")
        outside = ("", "experiments", "tests", "benchmarks", "ml_collections")
        higher = (
            first == "jradar"
            and rest
            and rest[0] in FLOORS
            and room in FLOORS
            and rest[0] != room
            and FLOORS[rest[0]] >= FLOORS[room]
        )
        if first in outside or higher:
            wrong.append(f"{module.relative_to(PACKAGE)} imports {name}")
    assert not wrong


def test_every_room_has_its_floor():
    rooms = {room_of(module) for module in MODULES} - {"__init__"}
    assert rooms == FLOORS.keys()


def test_array_rooms_read_no_files_and_options_are_parsed_in_the_command_line():
    wrong = []
    for module, name in IMPORTS:
        path = module.relative_to(PACKAGE).as_posix()
        touches_files = name in ("pathlib", "io", "tomllib", "jradar.files")
        if room_of(module) in PURE and touches_files and path not in READERS:
            wrong.append(f"{path} imports {name}")
        if name == "argparse" and room_of(module) != "cli":
            wrong.append(f"{path} imports argparse")
    assert not wrong


def test_public_functions_keep_the_house_style():
    wrong, functions = [], [*public_functions()]
    assert len(functions) > 100
    for name, function in functions:
        parameters = list(inspect.signature(function).parameters.values())
        if not function.__doc__:
            wrong.append(f"{name} has no docstring")
        if "key" in [parameter.name for parameter in parameters[1:]]:
            wrong.append(f"{name} takes a key, but not first")
        for parameter in parameters:
            optional = parameter.default is not inspect.Parameter.empty
            by_place = parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
            if optional and by_place and parameter.name != "description":
                wrong.append(
                    f"{name}: {parameter.name} is optional, but not by keyword"
                )
    assert not wrong


def test_importing_the_package_or_the_command_line_loads_no_jax():
    code = (
        "import sys, jradar, jradar.cli.options; "
        "jradar.cli.options.parser(); sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_every_room_and_name_is_listed_and_loads():
    for name in jradar.__all__:
        assert getattr(jradar, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'xyz'"):
        _ = jradar.xyz


def test_top_level_holds_what_was_agreed():
    root = PACKAGE.parent
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=root, capture_output=True, text=True
    )
    if tracked.returncode:
        pytest.skip("not a git checkout")
    top = {line.split("/")[0] for line in tracked.stdout.splitlines()}
    agreed = {"pyproject.toml", "jradar", "experiments", "tests", "benchmarks"}
    agreed |= {"README.md", "LICENSE"}
    assert {name for name in top if not name.startswith(".")} <= agreed
