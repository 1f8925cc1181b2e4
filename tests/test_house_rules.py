"""House rules: floors, circles, sizes, files, style of functions, laziness."""

import ast
import collections
import graphlib
import importlib
import inspect
import pydoc
import subprocess
from pathlib import Path

import pytest

import jradar
from tests.programs import finished

PACKAGE = Path(jradar.__file__).parent
ROOT = PACKAGE.parent
FLOORS = (
    *("errors compiled", "types range_code nearest fields files progress workers"),
    *("options", "radar range_image lidar diffusion metrics", "recordings model"),
    *("motion simulation viz", "calibration data pipeline"),
    *("outputs", "evaluation mapping", "training stream export", "cli"),
)
FLOORS = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms.split()}
PURE = (
    *("types", "nearest", "range_code"),
    *("radar", "range_image", "lidar", "diffusion", "metrics"),
)
READERS = (
    "diffusion/weights/files.py",
    "diffusion/weights/pretrained.py",
    "diffusion/perceptual.py",
)
MOST_MODULES = 14  # of a folder, next to its `__init__`
LARGER = {"experiments/configs": 99}  # recipes, not modules
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(module):
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_names(module):
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            home = "." * node.level + f"{node.module}"
            yield from (home, *(f"{home}.{alias.name}" for alias in node.names))


IMPORTS = [(m, name) for m in MODULES for name in imported_names(m)]


def public_functions():
    for room in FLOORS.keys() - {"cli"}:
        for name, value in vars(importlib.import_module(f"jradar.{room}")).items():
            function = inspect.unwrap(value) if callable(value) else None
            home = getattr(function, "__module__", "") or ""
            public = not name.startswith("_") and home.startswith("jradar.")
            if public and inspect.isfunction(function):
                yield f"{room}.{name}", function


def test_imports_come_from_the_own_room_or_a_lower_floor():
    wrong = []
    for module, name in IMPORTS:
        here, (first, *rest) = room_of(module), name.split(".")
        there = rest[0] if first == "jradar" and rest else here
        outside = ("", "experiments", "tests", "benchmarks", "ml_collections")
        higher = there != here and FLOORS.get(there, -1) >= FLOORS.get(here, 99)
        if first in outside or higher:
            wrong.append(f"{module.relative_to(PACKAGE)} imports {name}")
    assert not wrong


def steps_between_rooms(package):
    """Imports from room to room, and from folder to folder of one room.

    Each is (where, from, to). A room's own modules belong to all of its folders.
    """
    for module in (ROOT / package).rglob("*.py"):
        here = module.relative_to(ROOT).with_suffix("").parts
        for name in imported_names(module):
            first, room, folder, *_ = (*name.split("."), "", "")
            if first != package or not room:
                continue
            if room != here[1]:
                yield package, here[1], room
            elif folder and folder != here[2] and len(here) > 3:
                if (ROOT / package / room / folder).is_dir():
                    yield room, here[2], folder


@pytest.mark.parametrize("package", ["jradar", "experiments"])
def test_no_circle_of_imports_between_rooms_or_folders_of_a_room(package):
    graphs = collections.defaultdict(lambda: collections.defaultdict(set))
    for where, one, other in steps_between_rooms(package):
        graphs[where][one].add(other)
    assert len(graphs[package]) > 2
    for graph in graphs.values():
        graphlib.TopologicalSorter(graph).prepare()  # CycleError names the circle


def test_no_circle_of_files():
    paths = (module.relative_to(ROOT).with_suffix("").as_posix() for module in MODULES)
    names = [path.replace("/", ".").removesuffix(".__init__") for path in paths]
    graph = {}
    for name, module in zip(names, MODULES, strict=True):
        found = {*imported_names(module)} & {*names} - {name, "jradar"}
        packages = {other.rpartition(".")[0] for other in found}
        graph[name] = found - packages  # which a module's own name contains
    graphlib.TopologicalSorter(graph).prepare()  # CycleError names the circle


@pytest.mark.parametrize("package", ["jradar", "experiments"])
def test_folders_hold_at_most_a_dozen_modules_or_so(package):
    modules = (m for m in (ROOT / package).rglob("*.py") if m.stem != "__init__")
    counts = collections.Counter(m.parent.relative_to(ROOT).as_posix() for m in modules)
    wrong = {k: n for k, n in counts.items() if n > LARGER.get(k, MOST_MODULES)}
    assert counts and not wrong


def test_every_room_has_its_floor():
    rooms = {room_of(module) for module in MODULES} - {"__init__", "__main__"}
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
                wrong.append(f"{name}: {parameter.name} is optional, but by place")
    assert not wrong


def test_importing_the_package_or_the_command_line_loads_no_jax():
    code = (
        "import sys, jradar, jradar.cli.options; "
        "jradar.cli.options.parser(); sys.exit('jax' in sys.modules)"
    )
    assert finished(code).returncode == 0


def test_every_room_and_name_is_listed_and_loads():
    for name in jradar.__all__:
        assert getattr(jradar, name) is not None and name in dir(jradar)
    assert {*jradar.__all__} == {*jradar.NAMES} | FLOORS.keys()
    with pytest.raises(AttributeError, match="no attribute 'xyz'"):
        _ = jradar.xyz


def test_help_shows_the_front_door():
    text = pydoc.plain(pydoc.render_doc(jradar))
    assert "enhance(key" in text and "open_recording(path" in text
    assert "class PointCloud" in text


def test_top_level_holds_what_was_agreed():
    command = ["git", "ls-files"]
    tracked = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if tracked.returncode:
        pytest.skip("not a git checkout")
    top = {line.split("/")[0] for line in tracked.stdout.splitlines()}
    agreed = {"pyproject.toml", "jradar", "experiments", "tests", "benchmarks"}
    agreed |= {"README.md", "LICENSE"}
    assert {name for name in top if not name.startswith(".")} <= agreed
