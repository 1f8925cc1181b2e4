"""Captures with a capture.toml: places, times, poses, wrong descriptions."""

import shutil

import numpy as np
import pytest

from jradar.lidar import Poses
from jradar.recordings import describe as describe_recording, open_recording, read_tum
from jradar.recordings.capture import accumulate, open_capture
from jradar.recordings.recording import Stream

pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
from tests.recordings.bag_writer import livox_bag  # noqa: E402
from tests.recordings.coloradar_writer import write  # noqa: E402
from tests.recordings.dca1000_writer import (  # noqa: E402
    CFG,
    SHAPE,
    as_bytes,
    random_cubes,
)

CAPTURE = """\
[radar]
file = "adc_data.bin"
description = "radar.cfg"
start_time_s = 1000.5
xyz = [0.1, 0.2, 0.3]
rpy_degrees = [0, 0, 90]

[lidar]
file = "livox.bag"
xyz = [0, 0, 1]
rpy_degrees = [0, 30, 0]
accumulate = 3

[poses]
file = "poses.txt"
"""
FRAMES = 5
SPEED = 2.0  # of the base along the world's x axis, m/s


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The files of a capture: five frames, six clouds, a trajectory."""
    folder = tmp_path_factory.mktemp("written")
    (folder / "adc_data.bin").write_bytes(as_bytes(random_cubes(FRAMES)))
    (folder / "radar.cfg").write_text(CFG)
    poses = ["# t x y z qx qy qz qw"]
    poses += [f"{1000 + 0.1 * i} {SPEED * 0.1 * i} 0 0 0 0 0 1" for i in range(-1, 8)]
    (folder / "poses.txt").write_text("\n".join(poses))
    # A wall that stands at x = 10 in the world, seen from the moving LiDAR, level.
    scans = [
        [(0, 10 - SPEED * 0.1 * i, float(y), 0.5 * i, 7, 0, 0) for y in range(-2, 3)]
        for i in range(6)
    ]
    livox_bag(folder, "bag", scans, start=10**12).rename(folder / "livox.bag")
    return folder


@pytest.fixture
def folder(tmp_path, written):
    """A capture without its description."""
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def describe(folder, *replacements, text=CAPTURE):
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "capture.toml").write_text(text)
    return folder


def test_everything_lies_where_the_description_says(folder):
    recording = open_capture(describe(folder))
    assert recording.name == folder.name and len(recording.cubes) == FRAMES
    assert recording.cubes[1].shape == SHAPE
    np.testing.assert_allclose(recording.cubes.stamps, 1000.5 + 0.1 * np.arange(5))
    np.testing.assert_allclose(recording.lidar.stamps, 1000 + 0.1 * np.arange(6))
    assert len(recording.poses.stamps) == 9
    # Turned to the left by 90 degrees, the radar's x axis is the base's y axis.
    ahead = np.array([1.0, 0, 0, 1])
    moved = recording.base_from_radar @ ahead
    np.testing.assert_allclose(moved, [0.1, 1.2, 0.3, 1], atol=1e-12)
    moved = recording.base_from_lidar @ ahead  # pitched by 30 degrees, it looks down
    np.testing.assert_allclose(moved, [np.cos(np.pi / 6), 0, 0.5, 1], atol=1e-12)
    assert recording.notes == ()


def test_clouds_around_each_are_laid_over_it_by_the_poses(folder):
    level = ("rpy_degrees = [0, 30, 0]", "quaternion = [0, 0, 0, 1]")
    recording = open_capture(describe(folder, level))
    cloud = recording.lidar[2]
    assert cloud.shape == (15, 4) and cloud.dtype == np.float32
    np.testing.assert_allclose(cloud[:, 0], 10 - SPEED * 0.2, atol=1e-5)
    assert sorted(set(cloud[:, 2])) == [0.5, 1.0, 1.5]  # of clouds 1, 2 and 3
    assert len(recording.lidar[0]) == len(recording.lidar[5]) == 10
    alone = open_capture(describe(folder, level, ("accumulate = 3", ""))).lidar
    assert len(alone[2]) == 5
    poses = (folder / "poses.txt").read_text().splitlines()
    (folder / "poses.txt").write_text("\n".join(poses[4:]))  # from 1000.2 s on
    lidar = open_capture(describe(folder)).lidar
    assert [len(lidar[i]) for i in (0, 2, 3)] == [5, 10, 15]  # those with a pose


def test_accumulating_follows_a_turn():
    """Neighbours seen by a turning, shifted LiDAR fall on the same point."""
    stamps = np.arange(3.0)
    half = np.radians([0, 20, 50]) / 2
    turn = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], -1)
    poses = Poses(stamps, np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]]), turn)
    base_from_lidar = np.eye(4)
    base_from_lidar[:3, 3] = [0.3, -0.2, 1.0]
    seen = []
    for i, angle in enumerate(np.radians([0, 20, 50])):
        x, y, z = np.array([4.0, 3, 2]) - poses.xyz[i]
        cos, sin = np.cos(angle), np.sin(angle)
        base = np.array([cos * x + sin * y, cos * y - sin * x, z])
        seen.append(np.array([[*(base - base_from_lidar[:3, 3]), i]], np.float32))
    clouds = Stream(seen.__getitem__, 3, stamps)
    together = accumulate(clouds, 3, poses, base_from_lidar)[1]
    expected = np.tile(seen[1][:, :3], (3, 1))
    np.testing.assert_allclose(together[:, :3], expected, atol=1e-5)
    assert together[:, 3].tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("time", "start", "note"),
    [
        ("offset_s = 0.25", 1000.25, None),
        ("offset_s = -0.2", 999.8, None),
        ("", 1000.0, "the radar is assumed to start with the LiDAR"),
        ("start_time_s = 2000", 2000.0, "radar and LiDAR do not match: 2000."),
        ("start_time_s = 0", 0.0, "0.000 to 0.400 s against 1000.000 to 1000.500 s"),
    ],
)
def test_start_of_the_radar(folder, time, start, note):
    recording = open_capture(describe(folder, ("start_time_s = 1000.5", time)))
    assert recording.cubes.stamps[0] == pytest.approx(start)
    assert [note in text for text in recording.notes] == ([True] if note else [])


def test_radar_alone(folder):
    text = '[radar]\nfile = "adc_data.bin"\ndescription = "radar.cfg"\n'
    for path in (describe(folder, text=text), folder / "capture.toml"):
        recording = open_recording(path)
        assert recording.lidar is None and recording.poses is None
        assert recording.cubes.stamps[0] == 0 and recording.notes == ()
        np.testing.assert_array_equal(recording.base_from_radar, np.eye(4))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("description =", "descripton =", "'descripton', expected description"),
        ("[lidar]", "[lidr]", "unknown table 'lidr', expected lidar"),
        (CAPTURE, "", r"no \[radar\] table"),
        (CAPTURE, "radar = 3", "radar = 3, expected a table"),
        ('file = "adc_data.bin"', "", r"\[radar\] lacks file"),
        ('file = "adc_data.bin"', "file = 3", r"file = 3, expected a text"),
        ("accumulate = 3", "accumulate = 2.5", "2.5, expected an integer"),
        ("accumulate = 3", "accumulate = 0", "accumulate = 0 clouds"),
        ("1000.5", "true", "start_time_s = True, expected a number"),
        ("1000.5", "nan", "start_time_s = nan, expected a number"),
        ("1000.5", "1" + "0" * 400, "start_time_s = 10000.*, expected a number"),
        ("1000.5", "1.7e18", "milliseconds or nanoseconds"),
        ("1000.5", "1000.5\noffset_s = 1", "start_time_s and offset_s: keep one of"),
        ("1000.5", "1\nframe_period_s = 0.0", "frame_period_s"),
        ("[0.1, 0.2, 0.3]", "[100, 0, 0]", "are the numbers millimetres"),
        ("[0.1, 0.2, 0.3]", "[1, 0]", r"xyz = \[1, 0\], expected 3 numbers"),
        ("[0.1, 0.2, 0.3]", '["1", 0, 0]', "expected 3 numbers"),
        ("[0.1, 0.2, 0.3]", "[nan, 0, 0]", "expected 3 numbers"),
        ("xyz = [0, 0, 1]", "quaternion = [0, 0, 0, 1]", "keep one"),
        ("rpy_degrees = [0, 0, 90]", "quaternion = [1e90, 0, 0, 1]", "of length 1"),
        ("livox.bag", "other.bag", "no such bag"),
        ("poses.txt", "other.txt", "no such file of poses"),
        ("[poses]", "[poses", "not a TOML file"),
        ('"adc_data.bin"', '"../adc_data.bin"', r"copy or link the file of \[radar"),
        ('"radar.cfg"', '"a/../../radar.cfg"', "copy or link the description of"),
        ('"poses.txt"', '"/etc/passwd"', "'/etc/passwd', expected a path inside"),
    ],
)
def test_wrong_descriptions_are_named(folder, old, new, message):
    with pytest.raises(FileNotFoundError, match="no such description of a capture"):
        open_capture(folder)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        open_capture(describe(folder, (old, new)))


def test_files_below_the_folder_and_links_are_read(folder, tmp_path_factory):
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "shared.cfg"
    (folder / "radar.cfg").rename(elsewhere)
    (folder / "radar").mkdir()
    (folder / "radar" / "linked.cfg").symlink_to(elsewhere)
    text = CAPTURE.replace("radar.cfg", "radar/linked.cfg")
    assert len(open_capture(describe(folder, text=text)).cubes) == FRAMES


def test_clocks_that_do_not_match_are_described(folder):
    found = describe_recording(open_capture(describe(folder, ("1000.5", "0"))))
    spans = "the clocks do not match: 0.000 to 0.400 s against 1000.000 to 1000.500 s"
    assert found["frames with a LiDAR scan"] == spans
    assert found["frames with a pose"].startswith("the clocks do not match: 0.000 to")
    found = describe_recording(open_capture(describe(folder)))
    assert found["frames with a LiDAR scan"] == 1  # of the clouds, the last
    assert found["frames with a pose"] == 3


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1", "line 2: .* expected 8 numbers"),
        ("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1", "line 2: time 1.0 after 1.0"),
        ("1 0 0 0 0 0 0 1\n2 0 0 nan 0 0 0 1", "line 2"),
        ("1 0 0 0 0 0 0 0", "quaternion qx qy qz qw of length 1"),
        ("1 0 0 0 0 0 0 1", "holds 1 poses, expected 2 or more"),
        ("t x y z", "line 1: 't x y z'"),
        ("", "holds 0 poses"),
    ],
)
def test_wrong_poses_are_named(tmp_path, lines, message):
    with pytest.raises(ValueError, match=message):
        read_tum(write(tmp_path / "poses.txt", lines))
