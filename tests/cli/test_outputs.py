"""Commands replace only what they wrote themselves; all else stays as it is."""

import hashlib
import shutil

import pytest

from jradar.cli.options import parser
from tests.cli.conftest import QUICK
from tests.recordings.small_sequence import write_sequence

WORK = b"years of work\n"
KINDS = ("ply", "pcd", "csv", "npz")
OWN = (  # the names of all that commands write, and others
    *(f"{cloud}.{kind}" for cloud in ("radar", "enhanced") for kind in KINDS),
    *("000000/radar.ply", "000001/enhanced.npz", "radar/000000.pcd", "capture.png"),
    *("preparation.png", "manifest.json", "run0/0000.array_record", ".lock"),
    *("splits.json", "calib/notes.txt", "corridor_0/notes.txt", "thesis.txt"),
    *("map.ply", "grid.yaml", "map.png", "evaluation/report.html"),
    *("walk.tum", "my.toml", "function.jax", "out.mcap", "out.ros2/metadata.yaml"),
)


def hashes(folder):
    """The digest of every file, by its name."""
    found = [path for path in folder.rglob("*") if path.is_file()]
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in found}


@pytest.fixture
def own(tmp_path):
    """A folder of somebody's own files."""
    for name in OWN:
        path = tmp_path / "own" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(WORK)
    return tmp_path / "own"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A recording with LiDAR and poses."""
    return write_sequence(tmp_path_factory.mktemp("recordings"), frames=2)


@pytest.fixture(scope="module")
def commands(run, uncalibrated, model_folder, map_model_folder):
    """Every command that writes, with every kind of output: its words, and a name."""
    enhance = ["enhance", run, "--model", model_folder, *QUICK]
    live = ["live", "--replay", run, "--model", "none", "--silence", 60, "--speed", 2]
    prepare = ["prepare", run, "--workers", 1, "--frames", "0:1"]
    scene = ["simulate", "--scene", "corridor", "--frames", 1]
    return {
        "points": ["points", run],
        "points csv": ["points", run, "--format", "csv", "--deviations"],
        "points frames": ["points", run, "--frames", ":"],
        "points flat": ["points", run, "--frames", ":", "--flat", "--format", "pcd"],
        "enhance": enhance,
        "enhance frames": [*enhance, "--frames", ":"],
        "enhance flat": [*enhance, "--flat"],
        "out.mcap": enhance,
        "out.ros2": enhance,
        "live": live,
        "live.mcap": live,
        "record": ["record", "--replay", run, "--silence", 60, "--speed", 2],
        "my.toml": ["calibrate", uncalibrated],
        "walk.tum": ["odometry", run],
        "map": ["map", run, "--model", map_model_folder],
        "finetune": ["finetune", run, "--model", model_folder],
        "score": ["score", run, "--model", model_folder],
        "prepare": prepare,
        "preview": [*prepare, "--preview"],
        "scene": scene,
        "capture": [*scene, "--format", "capture"],
        "function.jax": ["export", model_folder, "--draws", 1, "--steps", 1],
    }


def test_files_of_somebody_else_are_never_touched(own, commands, refused):
    before = hashes(own)
    set_words = ["simulate", "--set", "jradar-sim-1-mini"]
    more = {"set": set_words, "": commands["function.jax"]}
    said = {
        "points": "radar.ply was not written by this command",
        "enhance frames": "000000/radar.ply was not written by this command",
        "points flat": "radar/000000.pcd was not written by this command",
        "enhance flat": "own/radar is not empty",
        "live": "000000/radar.ply was not written by this command",
        "record": "recordings are never overwritten",
        "walk.tum": "walk.tum was not written by this command",
        "map": "map.ply was not written by this command",
        "finetune": "which fine-tuning did not write",
        "score": "evaluation/report.html was not written by this command",
        "prepare": "own is neither empty nor a folder of records, it holds ",
        "preview": "preparation.png was not written by this command",
        "scene": "calib holds notes.txt but no simulated.txt",
        "capture": "corridor_0 holds notes.txt but no simulated.txt",
        "set": "manifest.json is damaged or not a JSON file",
        "": "own is a folder, expected the name of a file",
    }
    for name, words in (commands | more).items():
        output = own / name if (own / name).is_file() else own
        if output == own and "." in name:
            output = own / f"out{name[-5:]}"
        found = refused(*words, "-o", output, code=4 if name == "set" else 2)
        assert str(output) in found and said.get(name, "") in found
        never = words[0] in ("prepare", "finetune", "simulate", "record")
        forced = not never or "--preview" in words
        assert ("--force" in found) == (forced and name != ""), found
        assert hashes(own) == before, name


def test_no_command_takes_a_file_of_somebody_for_its_output(own, commands, refused):
    """Of every kind, or a link to one, or to nothing."""
    (own / "link").symlink_to(own / "thesis.txt")
    (own / "nowhere").symlink_to(own / "no thesis.txt")
    before = hashes(own)
    kinds = {path.suffix or path.name: path for path in own.rglob("*")}
    kinds = {kind: path for kind, path in kinds.items() if not path.is_dir()}
    for words in commands.values():
        for path in kinds.values():
            assert str(path) in refused(*words, "-o", path)
    assert hashes(own) == before
    (choices,) = (a.choices for a in parser()._actions if isinstance(a.choices, dict))
    writing = {name for name, sub in choices.items() if "--output" in sub.format_help()}
    assert writing == {words[0] for words in commands.values()}  # all are tried here


@pytest.mark.slow
def test_a_second_run_replaces_the_first_alone(own, commands, run_json, refused):
    pytest.importorskip("foxglove")
    before, new = hashes(own), own / "new"
    commands.pop("record", None)  # never replaces, see test_frame_recorder.py
    commands.pop("finetune", None)  # it resumes, see tests/test_finetuning.py
    for name, words in commands.items():
        run_json(*words, "-o", new / name)
    (new / "notes.txt").write_bytes(WORK)
    first = hashes(own)
    assert before.items() < first.items()
    for name, words in commands.items():
        if name.endswith((".mcap", ".ros2", "flat")):
            found = refused(*words, "-o", new / name)
            assert str(new / name) in found and "--force" in found
        else:
            run_json(*words, "-o", new / name)
    assert hashes(own).keys() == first.keys()
    assert before.items() < hashes(own).items()


@pytest.mark.slow
def test_results_of_another_command_or_changed_since_are_kept(
    own, commands, run_json, refused
):
    out, words = own / "new", commands["enhance"]
    run_json(*words, "-o", out)
    results = hashes(own)
    for other in ("points csv", "points flat", "live", "preview"):
        found = refused(*commands[other], "-o", out)
        assert f"{out} holds what `jradar enhance` wrote" in found
        assert "--force" in found and hashes(own) == results
    (out / "radar.ply").write_bytes(WORK)
    found = refused(*words, "-o", out)
    assert f"{out / 'radar.ply'} was not written by this command" in found
    assert "--force" in found
    # What is forced replaces the files of its names, and the other command's results.
    run_json(*commands["points csv"], "-o", out, "--force")
    names = {path.name for path in out.iterdir()}
    assert names == {".jradar", "capture.png", "radar.csv", "radar.npz", "radar.ply"}
    assert (out / "radar.ply").read_bytes() == WORK
    run_json(*commands["points"], "-o", out, "--force")
    names = {path.name for path in out.iterdir()}
    assert names == {".jradar", "capture.png", "radar.npz", "radar.ply"}
    assert (out / "radar.ply").read_bytes() != WORK


def test_force_replaces_single_files_and_bags(own, commands, run_json, refused):
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    for name in ("walk.tum", "out.mcap", "out.ros2"):
        path = own / name
        run_json(*commands[name], "-o", path, "--force")
        written = [path] if path.is_file() else [*path.iterdir()]
        assert written and all(WORK not in file.read_bytes() for file in written)
    (own / "out.ros2" / "thesis.txt").write_bytes(WORK)
    found = refused(*commands["out.ros2"], "-o", own / "out.ros2", "--force")
    assert "thesis.txt is not part of a bag" in found
    assert (own / "out.ros2" / "thesis.txt").read_bytes() == WORK


def test_an_input_is_never_replaced(small_cube, run, model_folder, tmp_path, refused):
    shutil.copytree(small_cube.removesuffix("/cube.npy"), tmp_path / "cube")
    cube, toml = tmp_path / "cube" / "cube.npy", tmp_path / "cube" / "radar.toml"
    link = tmp_path / "link.toml"
    link.symlink_to(toml)
    before = hashes(tmp_path)
    for words, output in (
        (["odometry", cube], cube),
        (["calibrate", cube, "--radar", toml], toml),
        (["calibrate", cube, "--radar", toml], link),
        (["export", model_folder, "--coupling", toml], toml),
        (["export", model_folder, "--radar", toml], toml),
        (["points", run], run),
        (["enhance", run, "--model", model_folder], model_folder),
        (["live", "--replay", run], run),
        (["prepare", run.parent], run.parent),
    ):
        found = refused(*words, "-o", output, *["--force"] * (words[0] != "prepare"))
        assert f"{output} is an input of this command" in found and "--force" in found
    assert hashes(tmp_path) == before


@pytest.mark.parametrize(
    ("words", "output", "expected"),
    [
        (
            ["enhance"],
            "cloud.ply",
            "expected that of a folder, or of a file of all fra",
        ),
        (["points"], "a.npz", "a.npz is the name of a file, expected that of a folder"),
        (["map"], "map.png", "expected that of a folder"),
        (["odometry"], "walk.csv", "expected a name that ends with .tum or .txt"),
        (["calibrate"], "mine.cfg", "expected a name that ends with .toml"),
    ],
)
def test_a_name_never_promises_another_kind_of_output(
    words, output, expected, small_cube, tmp_path, refused
):
    assert expected in refused(*words, small_cube, "-o", tmp_path / output)
    assert not (tmp_path / output).exists()
