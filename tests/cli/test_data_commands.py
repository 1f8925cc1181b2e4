"""`jradar prepare`, `simulate` and `view`."""

import pytest

from jradar.cli import main
from jradar.data import Records
from tests.recordings.small_sequence import write_sequence, write_stamps


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("sequences")
    write_sequence(root, "run0", frames=3)
    write_sequence(root, "run1", frames=2, lidar_delay=0.02, seed=1)
    return root


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "spec.toml"
    path.write_text("[points]\ncapacity = 64\n[lidar]\nmax_range_m = 7.0\n")
    return path


def test_prepare_prints_what_it_wrote_and_dropped(root, spec, tmp_path, run_json):
    result = run_json(
        "prepare", root, "-o", tmp_path / "dst", "--spec", spec, "--workers", 1
    )
    assert result["frames"] == 5 and len(result["sequences"]) == 2
    records = Records(tmp_path / "dst")
    assert len(records) == 5 and records[0].radar.xyz.shape == (64, 3)
    assert records.manifest["options"]["lidar"]["max_range_m"] == 7.0


def test_preview_draws_and_writes_nothing_else(root, spec, tmp_path, run_json):
    command = ["prepare", root, "-o", tmp_path, "--spec", spec, "--preview"]
    result = run_json(*command, "--frames", "1:2")
    assert result["frame"] == 1 and result["kept"] <= result["in the radar's view"]
    assert [p.name for p in tmp_path.iterdir()] == ["preparation.png"]


def test_an_unknown_field_of_the_spec_names_the_nearest(root, tmp_path, capsys):
    spec = tmp_path / "spec.toml"
    spec.write_text("[lidar]\nmax_range = 7.0\n")
    command = ["prepare", str(root), "-o", str(tmp_path / "dst"), "--spec", str(spec)]
    assert main(command) == 2
    assert "'max_range', expected max_range_m" in capsys.readouterr().err


def test_clocks_that_disagree_are_bad_data(tmp_path, capsys):
    folder = write_sequence(tmp_path / "src", frames=2)
    write_stamps(folder / "lidar", [5000.0, 5000.1])
    command = ["prepare", str(folder), "-o", str(tmp_path / "dst"), "--workers", "1"]
    assert main(command) == 4
    assert "do the two clocks agree" in capsys.readouterr().err


def test_simulated_frames_go_the_whole_way(tmp_path, run_json):
    pytest.importorskip("embreex")
    simulated = run_json(
        "simulate", "--scene", "lab", "--frames", 2, "-o", tmp_path / "sim"
    )
    assert simulated["frames per recording"] == 2
    info = run_json("info", tmp_path / "sim" / "lab_0")
    assert info["frames with a LiDAR scan"] == info["frames with a pose"] == 2
    assert 12 < info["radar"]["max_range_m"] < 16
    prepared = run_json(
        *("prepare", tmp_path / "sim", "-o", tmp_path / "dst", "--workers", 1),
    )
    assert prepared["frames"] == 2 and prepared["dropped"] == {}
    frame = Records(tmp_path / "dst")[1]
    assert len(frame.lidar_xyz) > 1000 and frame.cells.power.shape == (128, 128)


def test_view_of_a_folder_that_is_no_run(tmp_path, capsys):
    assert main(["view", str(tmp_path), "--no-open"]) == 2
    assert str(tmp_path) in capsys.readouterr().err
