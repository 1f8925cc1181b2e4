"""`--flat`: one folder for each kind of cloud, as other tools read them."""

import numpy as np
import pytest

from jradar.cli import main
from jradar.recordings import read_cloud
from tests.recordings.conftest import root as root, sequence as sequence

QUICK = ("--draws", "2", "--steps", "1")


def test_kiss_icp_reads_the_folder_in_order(sequence, model_folder, run_json, tmp_path):
    generic = pytest.importorskip("kiss_icp.datasets.generic")
    command = ["enhance", sequence, "--model", model_folder, *QUICK, "--frames", "8:11"]
    result = run_json(*command, "-o", tmp_path / "flat", "--flat")
    assert result["written"] == [str(tmp_path / "flat")]
    found = sorted(
        p.relative_to(tmp_path / "flat") for p in (tmp_path / "flat").rglob("*.*")
    )
    assert [*map(str, found)] == [
        f"{kind}/0000{number}.ply"
        for kind in ("enhanced", "radar")
        for number in ("08", "09", "10")
    ]
    run_json(*command, "-o", tmp_path / "deep")
    clouds = generic.GenericDataset(tmp_path / "flat" / "enhanced")
    assert len(clouds) == 3
    for number, row in enumerate(result["enhanced"], 8):
        alone = tmp_path / "deep" / f"{number:06d}" / "enhanced.ply"
        xyz, _ = clouds[number - 8]
        assert len(xyz) == row["enhanced points"] > 0
        columns = read_cloud(alone)
        expected = np.stack([columns[axis] for axis in "xyz"], -1)
        np.testing.assert_allclose(xyz, expected, atol=1e-6)


def test_detections_lie_in_one_folder_too(sequence, run_json, tmp_path):
    out = tmp_path / "out"
    command = ["points", sequence, "--flat", "--format", "csv", "-o", out]
    run_json(*command, "--frames", "1:3")
    assert sorted(p.name for p in (out / "radar").iterdir()) == [
        "000001.csv",
        "000002.csv",
    ]
    assert [p.name for p in out.iterdir()] == ["radar"]


def test_what_would_mix_clouds_is_refused(sequence, model_folder, tmp_path, capsys):
    def refused(*more):
        command = ["enhance", sequence, "--model", model_folder, "--flat"]
        assert main([*map(str, (*command, *more))]) == 2
        return capsys.readouterr().err

    (tmp_path / "old" / "enhanced").mkdir(parents=True)
    (tmp_path / "old" / "enhanced" / "000099.ply").touch()
    assert "enhanced is not empty" in refused("-o", tmp_path / "old")
    assert "is one file" in refused("-o", tmp_path / "a.mcap")
    message = refused("-o", tmp_path / "new", "--picture")
    assert "leave out --flat or --picture" in message
    assert not (tmp_path / "new").exists()
