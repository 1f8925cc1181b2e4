"""`jradar enhance --fuse`: what is fused, written, and refused."""

import shutil

import numpy as np
import pytest

from jradar.diffusion import PREDICTIONS, NoiseSpec, UNet
from jradar.model import save_model
from jradar.motion import following
from jradar.range_image import ConfidenceTable
from jradar.recordings import read_cloud
from tests.models import tiny_model

MODEL = tiny_model(
    method="marginal",
    network=UNet(
        channels=4, multipliers=(1,), blocks=1, attention_levels=(), outputs=14
    ),
    noise=NoiseSpec(sigma_data=0.7, prediction=PREDICTIONS["mixture"]),
    confidence=ConfidenceTable.of((0.0, 1.0), least=0.0),
)
SEARCH_M = 0.11  # by which `fuse` searches farther than `draw`


@pytest.fixture(scope="module")
def one_pass(tmp_path_factory):
    """The folder of a random model of one pass."""
    folder = tmp_path_factory.mktemp("one_pass") / "tiny"
    save_model(folder, MODEL)
    return str(folder)


@pytest.fixture
def enhance(walk, one_pass, run_json):
    """Run the command on the walk."""

    def run(*options, path=walk):
        command = ("enhance", path, "--model", one_pass, "--no-picture")
        return run_json(*command, *options)

    return run


def range_image(folder):
    with np.load(folder / "enhanced.npz") as file:
        assert {"confidence", "velocity", "range_image"} <= set(file.files)
        return file["range_image"]


def test_each_frame_is_fused_with_those_before_it(enhance, tmp_path):
    result = enhance("--fuse", 3, "--frames", ":", "-o", tmp_path / "all")
    assert result["frames_fused"] == 3 and result["motion_by"] == {"poses": 3}
    assert [row["frame"] for row in result["enhanced"]] == [0, 1, 2, 3]
    assert result["milliseconds_per_frame"]["fusion"] > 0
    alone = enhance("--frames", ":", "-o", tmp_path / "alone")
    assert "frames_fused" not in alone
    for frame, same in (("000000", True), ("000003", False)):
        fused, one = (range_image(tmp_path / k / frame) for k in ("all", "alone"))
        assert np.allclose(fused, one, atol=SEARCH_M) == same

    # A frame does not depend on where the command begins.
    result = enhance("--fuse", 3, "--frame", 3, "-o", tmp_path / "one")
    assert result["frame"] == 3
    one, among_others = (range_image(tmp_path / k) for k in ("one", "all/000003"))
    np.testing.assert_allclose(one, among_others, atol=1e-4)
    assert len(read_cloud(tmp_path / "one" / "enhanced.ply")["x"])


def test_without_poses_the_radar_and_its_imu_show_the_motion(enhance, walk, tmp_path):
    shutil.copytree(walk.parent, tmp_path / "data")
    copied = tmp_path / "data" / walk.name
    for kind, folder in (("imu", "groundtruth"), ("velocity", "imu")):
        shutil.rmtree(copied / folder)
        result = enhance("--fuse", 3, "--frame", 3, "-o", tmp_path / kind, path=copied)
        assert result["motion_by"] == {kind: 2}


def test_frames_without_known_motion_stand_alone_with_a_note(
    enhance, tmp_path, monkeypatch
):
    monkeypatch.setattr(following, "LONGEST_STEP_S", -1.0)
    unknown = ("poses", following.UNKNOWN)
    monkeypatch.setattr(following.Follower, "_by_poses", lambda *_: unknown)
    command = ("--frames", "2:", "-o")
    result = enhance(*command, tmp_path / "a", "--fuse", 3)
    assert result["motion_by"] == {"none": 3}
    assert any("motion into frame 1, 2, 3 is unknown" in n for n in result["notes"])
    enhance(*command, tmp_path / "b")
    fused, one = (range_image(tmp_path / k / "000003") for k in "ab")
    np.testing.assert_allclose(fused, one, atol=SEARCH_M)


def test_models_that_draw_and_recordings_of_one_frame_are_refused(
    walk, small_cube, model_folder, one_pass, tmp_path, refused
):
    for path, model, message, more in (
        (walk, model_folder, "expected marginal", ()),
        (small_cube, one_pass, "has one frame, expected several", ()),
        (walk, one_pass, "draws no samples", ("--draws", "2")),
    ):
        command = ["enhance", path, "--model", model, "--fuse", 3, *more]
        assert message in refused(*command, "-o", tmp_path / "out")
        assert not (tmp_path / "out").exists()
