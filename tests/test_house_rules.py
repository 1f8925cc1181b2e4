"""House rules: floors, key first, options by keyword, docstrings, lazy imports."""

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
    "files": 1,
    "types": 1,
    "nearest": 1,
    "progress": 1,
    "errors": 1,
    "radar": 2,
    "range_image": 2,
    "lidar": 2,
    "diffusion": 2,
    "metrics": 2,
    "model": 3,
    "recordings": 3,
    "data": 4,
    "simulation": 4,
    "viz": 4,
    "baselines": 4,
    "training": 5,
    "evaluation": 5,
    "export": 5,
    "cli": 6,
}
ROOMS = (
    "radar",
    "range_image",
    "lidar",
    "diffusion",
    "recordings",
    "data",
    "simulation",
    "baselines",
    "training",
    "evaluation",
    "viz",
)
MODULES = sorted(PACKAGE.rglob("*.py"))


def room_of(module):
    return module.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_names(module):
    for node in ast.walk(ast.parse(module.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def public_functions():
    for room in ("metrics", "model", "files", *ROOMS):
        module = importlib.import_module(f"jradar.{room}")
        for name, value in vars(module).items():
            function = inspect.unwrap(value) if callable(value) else None
            home = getattr(function, "__module__", "") or ""
            if inspect.isfunction(function) and not name.startswith("_"):
                if home.startswith("jradar."):
                    yield pytest.param(function, id=f"{room}.{name}")


@pytest.mark.parametrize("module", MODULES, ids=lambda m: str(m.relative_to(PACKAGE)))
def test_imports_come_from_the_own_room_or_a_lower_floor(module):
    room = room_of(module)
    if room == "__init__":
        return
    for name in imported_names(module):
        first, *rest = name.split(".")
        assert first not in ("experiments", "tests", "benchmarks", "ml_collections")
        if first == "jradar" and rest[0] in FLOORS and rest[0] != room:
            assert FLOORS[rest[0]] < FLOORS[room], f"{room} imports {name}"


@pytest.mark.parametrize("function", [*public_functions()])
def test_public_function_keeps_the_house_style(function):
    assert function.__doc__, "needs a docstring"
    parameters = list(inspect.signature(function).parameters.values())
    names = [parameter.name for parameter in parameters]
    assert "key" not in names[1:], "a key comes first"
    for parameter in parameters:
        optional = parameter.default is not inspect.Parameter.empty
        by_place = parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
        allowed = ("description",)  # open_recording(path, description): no option
        assert not (optional and by_place) or parameter.name in allowed, parameter.name


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
