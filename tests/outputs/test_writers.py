"""Outputs: files that other programs read; nothing is overwritten."""

import collections
import itertools
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from PIL import Image, ImageSequence

from jradar.errors import UsageError
from jradar.outputs.published import range_azimuth
from jradar.outputs.video import points_shown
from jradar.outputs.writers import open_writer
from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.radar.angle.spectrum import direction_sines
from jradar.recordings import describe_file, open_recording, read_cloud
from jradar.types import PointCloud
from tests.outputs.readers import mcap_messages
from tests.outputs.scenes import columns_of, frame_of

FRAMES = [frame_of(number) for number in range(3)]


def write(path, frames=FRAMES):
    writer = open_writer(path)
    try:
        for frame in frames:
            writer.write(frame)
    finally:
        writer.close()
    return path


def test_a_bag_is_accepted_by_the_converter_and_by_our_own_reader(tmp_path):
    pytest.importorskip("rosbags")
    from jradar.recordings.bags.bags import bag_topics, open_bag

    path, converted = write(tmp_path / "out.ros2"), tmp_path / "out.bag"
    command = [sys.executable, "-m", "rosbags.convert", "--src", path, "--dst"]
    done = subprocess.run([*command, converted], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for bag in (path, converted):
        assert bag_topics(bag)["/radar/points"] == ("sensor_msgs/msg/PointCloud2", 3)
        clouds = open_bag(bag, topic="/radar/points")
        columns = columns_of(FRAMES[1].clouds["radar"])
        np.testing.assert_array_equal(clouds[1][:, 0], columns["x"])


def test_a_folder_holds_clouds_that_can_be_read(tmp_path):
    path = write(tmp_path / "out")
    found = read_cloud(path / "000002" / "radar.ply")
    np.testing.assert_equal(found, columns_of(FRAMES[2].clouds["radar"]))
    assert (path / "000000" / "lidar.npz").is_file()


def test_the_verdict_is_in_the_files_of_an_enhanced_cloud(tmp_path):
    verdict = ("9% of its points may be right", "do not trust frame 1")
    enhanced = {"enhanced": FRAMES[0].clouds["radar"]}
    path = write(
        tmp_path / "out", [FRAMES[0]._replace(clouds=enhanced, verdict=verdict)]
    )
    assert b"comment do not trust frame 1" in next(path.rglob("*.ply")).read_bytes()
    with np.load(next(path.rglob("*.npz"))) as arrays:
        assert (*arrays["verdict"],) == verdict
    (found,) = open_recording(path / "000000" / "enhanced.npz").points
    assert found.xyz.shape == (50, 3)  # texts are not a column


@pytest.mark.parametrize("name", ["out.mcap", "out.ros2", "out"])
def test_an_empty_cloud_is_written(tmp_path, name):
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    empty = PointCloud(np.zeros((4, 3), np.float32), np.zeros(4, bool))
    write(tmp_path / name, [FRAMES[0]._replace(clouds={"enhanced": empty})])
    assert (tmp_path / name).exists()


def test_other_names_what_exists_and_missing_packages_are_named(tmp_path, monkeypatch):
    with pytest.raises(UsageError, match=r"expected an \.mcap file, a \.ros2 bag"):
        open_writer(tmp_path / "out.bag")
    needed = ("foxglove", "out.mcap", "live"), ("rosbags.rosbag2", "out.ros2", "ros")
    for package, name, extra in needed:
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(ImportError, match=rf"pip install 'jradar\[{extra}\]'"):
            open_writer(tmp_path / name)
        (tmp_path / name).mkdir()
        with pytest.raises(UsageError, match="exists and is not overwritten"):
            open_writer(tmp_path / name)


def test_an_mcap_file_is_listed_without_its_messages(tmp_path):
    path = write(tmp_path / "out.mcap")
    counts = collections.Counter(message[:2] for message in mcap_messages(path))
    found = describe_file(path)
    rows = {(row["topic"], row["type"]): row["messages"] for row in found["topics"]}
    assert rows == dict(counts) and found["first_s"] <= found["last_s"]
    assert found["notes"] == []
    path.write_bytes(path.read_bytes()[:-20])
    cut = describe_file(path)
    assert cut["topics"] == found["topics"] and "was cut off" in cut["notes"][0]
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(ValueError, match="is damaged or not an MCAP file"):
        describe_file(path)


def test_a_video_shows_frame_after_frame(tmp_path):
    with Image.open(write(tmp_path / "walk.gif")) as video:
        assert video.n_frames == len(FRAMES) and video.info["duration"] == 100
        shown = [np.asarray(f.convert("RGB")) for f in ImageSequence.Iterator(video)]
    assert all((a != b).any() for a, b in itertools.pairwise(shown))
    assert [path.name for path in tmp_path.iterdir()] == ["walk.gif"]
    write(tmp_path / "none.gif", frames=[])
    assert not (tmp_path / "none.gif").exists()


def test_an_mp4_asks_for_ffmpeg_where_it_is_missing(tmp_path, monkeypatch):
    monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
    with pytest.raises(UsageError, match="name a .gif"):
        write(tmp_path / "walk.mp4")


def test_a_video_leaves_weak_radar_points_out():
    xyz, valid = jnp.eye(3), jnp.ones(3, bool)
    cloud = PointCloud(xyz, valid, snr=jnp.array([2.0, 20.0, 30.0]))
    found = points_shown({"radar": cloud}, "radar")
    np.testing.assert_array_equal(found, np.eye(3)[1:])
    assert len(points_shown({"radar": PointCloud(xyz, valid)}, "radar")) == 3
    assert len(points_shown({}, "lidar")) == 0


def test_the_picture_shows_an_echo_where_it_is():
    """Far is up, left is left."""
    radar = RadarSpec.awr1843(num_chirps=8, num_samples=64)
    left, distance = np.radians(30), 20 * radar.range_resolution_m
    xyz = distance * np.array([[np.cos(left), np.sin(left), 0]])
    echo = Scatterers(jnp.asarray(xyz, jnp.float32), jnp.zeros(1), jnp.ones(1))
    cube = simulate_cube(jax.random.key(0), echo, radar)
    picture = np.asarray(range_azimuth(cube, radar))
    row, column = np.unravel_index(picture.argmax(), picture.shape)
    assert len(picture) - 1 - row == 20
    u, _ = direction_sines(radar)
    assert abs(u[::-1][column] - np.sin(left)) < u[1] - u[0] and column < 32
    assert not np.asarray(range_azimuth(0 * cube, radar)).any()
