"""`jradar enhance --fuse`: how the motion is found, printed, and refused."""

import shutil

import numpy as np
import pytest

from jradar.model import save_model
from jradar.motion import following
from tests.models import one_pass_model

SEARCH_M = 0.11  # by which `fuse` searches farther than `draw`


@pytest.fixture(scope="module")
def one_pass(tmp_path_factory):
    """The folder of a random model of one pass."""
    folder = tmp_path_factory.mktemp("one_pass") / "tiny"
    save_model(folder, one_pass_model())
    return str(folder)


@pytest.fixture
def enhance(walk, one_pass, run_json, tmp_path):
    """Run the command on the walk; return its result and the last frame's image."""

    def run(name, *options, path=walk):
        out = tmp_path / name
        command = ("enhance", path, "--model", one_pass, "--no-picture", "-o", out)
        result = run_json(*command, *options)
        (last,) = {*out.glob("enhanced.npz"), *out.glob("000003/enhanced.npz")}
        with np.load(last) as file:
            assert {"confidence", "velocity", "range_image"} <= set(file.files)
            return result, file["range_image"]

    return run


@pytest.mark.slow
def test_each_frame_is_fused_with_those_before_it(enhance):
    result, fused = enhance("all", "--fuse", 3, "--frames", "1:")
    assert result["frames_fused"] == 3 and result["motion_by"] == {"poses": 3}
    assert [row["frame"] for row in result["enhanced"]] == [1, 2, 3]
    assert result["milliseconds_per_frame"]["fusion"] > 0
    # A frame does not depend on where the command begins.
    result, one = enhance("one", "--fuse", 3, "--frame", 3)
    assert result["frame"] == 3
    np.testing.assert_allclose(one, fused, atol=1e-4)


@pytest.mark.slow
def test_without_poses_the_radar_and_its_imu_show_the_motion(enhance, walk, tmp_path):
    shutil.copytree(walk.parent, tmp_path / "data")
    copied = tmp_path / "data" / walk.name
    for kind, folder in (("imu", "groundtruth"), ("velocity", "imu")):
        shutil.rmtree(copied / folder)
        result, _ = enhance(kind, "--fuse", 3, "--frame", 3, path=copied)
        assert result["motion_by"] == {kind: 2}


def test_frames_without_known_motion_stand_alone_with_a_note(enhance, monkeypatch):
    monkeypatch.setattr(following, "LONGEST_STEP_S", -1.0)
    unknown = ("poses", following.UNKNOWN)
    monkeypatch.setattr(following.Follower, "_by_poses", lambda *_: unknown)
    result, fused = enhance("fused", "--fuse", 3, "--frames", "2:")
    assert result["motion_by"] == {"none": 3}
    assert any("motion into frame 1, 2, 3 is unknown" in n for n in result["notes"])
    result, alone = enhance("alone", "--frames", "2:")
    assert "frames_fused" not in result
    np.testing.assert_allclose(fused, alone, atol=SEARCH_M)


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
