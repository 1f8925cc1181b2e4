"""Tables with named columns, in files and folders, with poses next to them."""

import gzip

import numpy as np
import pytest

from jradar import PointCloud
from jradar.errors import UsageError
from jradar.recordings import holds_points, is_recording, open_recording
from jradar.recordings.points.frames import static_fits

RNG = np.random.default_rng(0)
XYZ = RNG.uniform((2, -3, -1), (8, 3, 1), (30, 3)).astype(np.float32)
CLOUD = PointCloud(
    *(XYZ, np.ones(30, bool)),  # pyright: ignore[reportArgumentType]
    velocity=RNG.normal(size=30).astype(np.float32),  # pyright: ignore[reportArgumentType]
    power=RNG.uniform(1e3, 1e6, 30).astype(np.float32),  # pyright: ignore[reportArgumentType]
)
TURN = np.array([[0.0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def write_csv(path, rows, names):
    lines = [",".join(f"{value:.17g}" for value in row) for row in rows]
    path.write_text("\n".join([",".join(names), *lines]) + "\n")


@pytest.mark.parametrize("kind", ["ply", "pcd", "csv", "npz"])
def test_what_jradar_writes_reads_back(tmp_path, kind):
    for frame in (2, 10, 1):
        CLOUD.save(tmp_path / f"{frame}.{kind}")
    for path, frames in ((tmp_path, 3), (tmp_path / f"2.{kind}", 1)):
        assert holds_points(path)
        found = open_recording(path)
        assert len(found.points) == frames and found.points.stamps is None
        cloud = found.points[0]
        np.testing.assert_array_equal(cloud.xyz, XYZ)
        np.testing.assert_array_equal(cloud.velocity, CLOUD.velocity)
        np.testing.assert_array_equal(cloud.power, CLOUD.power)
        assert cloud.valid.all() and isinstance(cloud.xyz, np.ndarray)


def test_clouds_of_a_lidar_and_of_a_model_are_not_a_radars(tmp_path):
    PointCloud.from_xyz(XYZ).save(tmp_path / "lidar.ply")
    CLOUD._replace(confidence=CLOUD.velocity).save(tmp_path / "enhanced.ply")
    assert not is_recording(tmp_path) and not is_recording(tmp_path / "enhanced.ply")
    with pytest.raises(UsageError, match="holds no recording, expected .*a radar's p"):
        open_recording(tmp_path)


def test_a_file_of_many_frames_has_their_numbers_and_times(tmp_path):
    frame = np.repeat([3, 4, 6], [10, 5, 15])
    stamp = 1_700_000_000_000 + 50 * frame  # ms
    rows = np.column_stack([stamp, frame, XYZ, CLOUD.velocity])
    path = tmp_path / "walk.csv"
    write_csv(path, rows, ["Timestamp", "Frame Number", "X", "Y", "Z", "V_r"])
    found = open_recording(path)
    assert [len(cloud.valid) for cloud in found.points] == [10, 5, 15]
    np.testing.assert_allclose(found.points.stamps - 1.7e9, [0.15, 0.2, 0.3], atol=1e-6)


def test_names_of_files_hold_times(tmp_path):
    for k in range(4):
        CLOUD.save(tmp_path / f"radar_{1_700_000_000_000_000 + 100_000 * k}.ply")
    stamps = open_recording(tmp_path).points.stamps
    np.testing.assert_allclose(stamps, 1.7e9 + 0.1 * np.arange(4), atol=1e-5)


def test_poses_of_4_x_4_belong_to_the_frames(tmp_path):
    for k in range(3):
        CLOUD.save(tmp_path / f"{k}.ply")
    np.save(tmp_path / "poses.npy", np.stack([TURN] * 3))
    found = open_recording(tmp_path)
    assert found.poses is not None
    np.testing.assert_allclose(found.poses.xyz, [(1, 2, 3)] * 3)
    np.testing.assert_allclose(found.poses.quaternion[0], (0, 0, 0.5**0.5, 0.5**0.5))
    np.testing.assert_allclose(found.points.stamps, (0, 0.1, 0.2))
    assert any("0.1 s between them are assumed" in note for note in found.notes)
    np.save(tmp_path / "poses.npy", np.stack([TURN] * 2))
    with pytest.raises(UsageError, match="for each of 3 frames"):
        open_recording(tmp_path)
    np.save(tmp_path / "poses.npy", 2 * np.stack([TURN] * 3))
    with pytest.raises(ValueError, match="not rotations"):
        open_recording(tmp_path)


def test_poses_of_tum_are_on_the_frames_clock(tmp_path):
    for k in range(4):
        CLOUD.save(tmp_path / f"{1_700_000_000 + k}.ply")
    lines = [f"{1_700_000_000 + k} {k} 0 0 0 0 0 1" for k in range(4)]
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    found = open_recording(tmp_path)
    assert found.poses is not None
    np.testing.assert_array_equal(found.poses.stamps, found.points.stamps)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"x": XYZ[:, 1], "y": XYZ[:, 0]}, "x right, y forward, z up: they are rot"),
        ({"x": 1000 * XYZ[:, 0]}, "are they in millimetres"),
        ({"x": -XYZ[:, 0]}, "of the points lie behind the radar"),
        ({"v": np.zeros(30)}, "every velocity is 0"),
        ({"v": np.full(30, np.nan)}, "no frame that was looked at holds a point"),
    ],
)
def test_odd_points_are_named(tmp_path, columns, said):
    table = {**dict(zip("xyz", XYZ.T, strict=True)), "v": CLOUD.velocity}
    np.savez(tmp_path / "a.npz", **(table | columns))
    notes = open_recording(tmp_path / "a.npz").notes
    assert any(said in note for note in notes)


def test_points_without_doppler_are_a_recording(tmp_path):
    table = dict(zip("xyz", XYZ.T, strict=True))
    np.savez(tmp_path / "a.npz", **table, rcs=CLOUD.velocity)
    found = open_recording(tmp_path / "a.npz")
    assert found.points[0].velocity is None
    assert "the points have no Doppler velocity" in found.notes


def test_a_lidars_number_of_points_is_noticed(tmp_path):
    many = np.tile(XYZ, (3400, 1))
    np.savez(tmp_path / "a.npz", xyz=many, velocity=many[:, 1])
    assert any("102,000 points" in n for n in open_recording(tmp_path / "a.npz").notes)


@pytest.mark.parametrize(
    ("stamps", "said", "known"),
    [
        ([0, 0, 0, 0], "stamps are all alike", False),
        ([1.0, 1.1, 1.05, 1.2], "stamps of 1 frames do not rise", True),
        ([*np.arange(0, 2, 0.1), 50.0], "stamps jump 1 times", True),
    ],
)
def test_odd_stamps_are_named(stamps, said, known):
    from jradar.recordings.points.frames import checked_stamps

    found, notes = checked_stamps(np.array(stamps, float))
    assert any(said in note for note in notes) and (found is not None) == known


def test_velocities_of_the_other_sign_are_noticed(tmp_path):
    ahead = np.array([3.0, 0, 0])
    velocity = XYZ / np.linalg.norm(XYZ, axis=1, keepdims=True) @ ahead
    for sign, noticed in ((-1, False), (1, True)):
        np.savez(tmp_path / "a.npz", xyz=XYZ, velocity=sign * velocity)
        notes = " ".join(open_recording(tmp_path / "a.npz").notes)
        assert ("backwards at 3.0 m/s" in notes) == noticed
    strange = np.random.default_rng(0).uniform(-9, 9, len(XYZ))
    some = np.arange(len(XYZ)) % 5 < 2  # what a static world explains
    np.savez(tmp_path / "a.npz", xyz=XYZ, velocity=np.where(some, velocity, strange))
    recording = open_recording(tmp_path / "a.npz")
    share, _, forward = static_fits([*recording.points]) or (0, 0, 0)
    assert forward < -2 and 0.3 < share < 0.5
    assert "backwards" not in " ".join(recording.notes)


def test_damaged_files_are_a_clear_error(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("x,y,z,velocity\n1,2,3,4\n1,2\n")
    with pytest.raises(ValueError, match="a.csv is damaged"):
        open_recording(path)


def test_a_file_of_a_folder_without_places_is_named(tmp_path):
    for k in range(3):
        CLOUD.save(tmp_path / f"{k}.csv")
    (tmp_path / "1.csv").write_text("a,b,velocity\n1,2,3\n")
    with pytest.raises(ValueError, match=r"1.csv has the columns a, b, velocity, exp"):
        open_recording(tmp_path)
    (tmp_path / "1.csv").write_text("")
    with pytest.raises(ValueError, match=r"1.csv has the columns none, expected x, y"):
        open_recording(tmp_path)


@pytest.mark.parametrize("by", ["Frame", "Timestamp"])
def test_a_folder_of_files_of_several_frames_holds_recordings(tmp_path, by):
    for k in range(2):
        rows = np.column_stack([np.repeat([1.0, 2, 3], 10), XYZ, CLOUD.velocity])
        write_csv(tmp_path / f"{k}.csv", rows, [by, "x", "y", "z", "velocity"])
    assert not is_recording(tmp_path) and is_recording(tmp_path / "0.csv")
    with pytest.raises(UsageError, match=r"not a recording; name one inside it: .*0.c"):
        open_recording(tmp_path)


def test_the_points_of_a_frame_may_have_their_own_times(tmp_path):
    for k in range(2):
        rows = np.column_stack([k + 0.01 * (XYZ[:, 0] > 4), XYZ, CLOUD.velocity])
        write_csv(tmp_path / f"{k}.csv", rows, ["time", "x", "y", "z", "velocity"])
    assert len(open_recording(tmp_path).points) == 2


def test_info_says_what_was_taken_for_what(tmp_path, capsys):
    from jradar.cli import main

    CLOUD.save(tmp_path / "a.ply")
    assert main(["info", str(tmp_path / "a.ply")]) == 0
    shown = capsys.readouterr().out
    assert "velocity (receding positive)" in shown and "power (linear)" in shown


def test_real_points_of_an_oculii(samples, tmp_path):
    path = tmp_path / "pcl.csv"
    path.write_bytes(gzip.open(samples / "oculii/pcl.csv.gz").read())
    found = open_recording(path)
    sizes = [len(cloud.valid) for cloud in found.points]
    assert len(sizes) == 229 and (min(sizes), max(sizes)) == (26, 78)
    assert np.ptp(found.points.stamps) == pytest.approx(19.0, abs=0.1)
    assert all((cloud.xyz[:, 0] > 0).all() for cloud in found.points)
    with pytest.raises(UsageError, match="an Oculii Eagle, which are not read"):
        open_recording(samples / "oculii/20221209.pcap")
