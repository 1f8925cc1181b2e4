"""Outputs: other programs read back every field; nothing is overwritten."""

import asyncio
import contextlib
import json
import signal
import struct
import subprocess
import sys
import threading
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.radar import RadarSpec, Scatterers, direction_sines, simulate_cube
from jradar.recordings import read_cloud
from jradar.stream.outputs import open_writer
from jradar.stream.views import point_table, range_azimuth
from jradar.types import PointCloud
from tests.stream.scenes import columns_of, view_of

VIEWS = [view_of(number) for number in range(3)]
QUATERNION = [0, 0, 0.6, 0.8]


def write(path, views=VIEWS):
    writer = open_writer(path)
    try:
        for view in views:
            writer.write(view)
    finally:
        writer.close()
    return path


def mcap_messages(path):
    """(topic, schema, time, message) of an MCAP file, by the package of its authors."""
    pytest.importorskip("foxglove")
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    with path.open("rb") as file:
        found = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, message, decoded in found.iter_decoded_messages():
            yield channel.topic, schema.name, message.log_time, decoded


def table_of(message):
    """The points in a foxglove.PointCloud, by name."""
    fields = message.fields
    assert all(field.type == 7 for field in fields)  # float32
    kind = {"names": [f.name for f in fields], "formats": ["<f4"] * len(fields)}
    kind |= {"offsets": [f.offset for f in fields], "itemsize": message.point_stride}
    table = np.frombuffer(message.data, np.dtype(kind))
    return {name: table[name] for name in table.dtype.names}


def assert_same_columns(found, cloud):
    expected = columns_of(cloud)
    assert found.keys() == expected.keys()
    for name, column in expected.items():
        np.testing.assert_array_equal(found[name], column)


def test_an_mcap_file_read_back_field_by_field(tmp_path):
    pytest.importorskip("foxglove")
    messages = [*mcap_messages(write(tmp_path / "out.mcap"))]
    assert len(messages) == 4 * len(VIEWS)
    by_topic = {}
    for topic, schema, time_ns, message in messages:
        by_topic.setdefault((topic, schema), []).append((time_ns, message))
    for name in ("radar", "lidar"):
        found = by_topic[f"/{name}/points", "foxglove.PointCloud"]
        for (time_ns, message), view in zip(found, VIEWS, strict=True):
            assert time_ns == view.stamp_ns == message.timestamp.ToNanoseconds()
            assert message.frame_id == "radar" and message.pose.orientation.w == 1
            assert_same_columns(table_of(message), view.clouds[name])
    pictures = by_topic["/radar/range_azimuth", "foxglove.RawImage"]
    for (_, image), view in zip(pictures, VIEWS, strict=True):
        shape = (image.encoding, image.width, image.height, image.step)
        assert shape == ("mono8", 4, 6, 4)
        assert image.data == view.picture.tobytes()
    _, tf = by_topic["/tf", "foxglove.FrameTransforms"][0]
    first, second = tf.transforms
    assert (first.parent_frame_id, first.child_frame_id) == ("base", "radar")
    place = [getattr(first.translation, axis) for axis in "xyz"]
    turn = [getattr(first.rotation, axis) for axis in "xyzw"]
    np.testing.assert_allclose(place + turn, [0.1, 0.2, 0.3, *QUATERNION], atol=1e-12)
    assert second.child_frame_id == "lidar" and second.translation.z == 1


def test_a_ros_2_bag_read_back_field_by_field(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    path = write(tmp_path / "out.ros2")
    with highlevel.AnyReader([path], default_typestore=store) as reader:
        found = {}
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((time_ns, message))
    for name in ("radar", "lidar"):
        for (time_ns, cloud), view in zip(found[f"/{name}/points"], VIEWS, strict=True):
            stamp = cloud.header.stamp
            assert time_ns == view.stamp_ns == stamp.sec * 10**9 + stamp.nanosec
            assert (cloud.header.frame_id, cloud.height) == ("radar", 1)
            assert cloud.row_step == cloud.width * cloud.point_step == len(cloud.data)
            assert cloud.is_dense and not cloud.is_bigendian
            assert all((f.datatype, f.count) == (7, 1) for f in cloud.fields)
            table = cloud.data.view("<f4").reshape(cloud.width, -1)
            columns = {f.name: table[:, f.offset // 4] for f in cloud.fields}
            assert_same_columns(columns, view.clouds[name])
    for (_, image), view in zip(found["/radar/range_azimuth"], VIEWS, strict=True):
        assert (image.encoding, image.height, image.width) == ("mono8", 6, 4)
        np.testing.assert_array_equal(image.data.reshape(6, 4), view.picture)
    (_, tf), *_ = found["/tf"]
    first = tf.transforms[0]
    assert (first.header.frame_id, first.child_frame_id) == ("base", "radar")
    turn = [getattr(first.transform.rotation, axis) for axis in "xyzw"]
    np.testing.assert_allclose(turn, QUATERNION, atol=1e-12)


def test_a_bag_is_accepted_by_the_converter_and_by_our_own_reader(tmp_path):
    pytest.importorskip("rosbags")
    from jradar.recordings import bag_topics, open_bag

    path, converted = write(tmp_path / "out.ros2"), tmp_path / "out.bag"
    command = [sys.executable, "-m", "rosbags.convert", "--src", path, "--dst"]
    done = subprocess.run([*command, converted], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for bag in (path, converted):
        assert bag_topics(bag)["/radar/points"] == ("sensor_msgs/msg/PointCloud2", 3)
        clouds = open_bag(bag, topic="/radar/points")
        columns = columns_of(VIEWS[1].clouds["radar"])
        np.testing.assert_array_equal(clouds[1][:, 0], columns["x"])


def test_a_folder_holds_clouds_that_can_be_read(tmp_path):
    path = write(tmp_path / "out")
    found = read_cloud(path / "000002" / "radar.ply")
    assert_same_columns(found, VIEWS[2].clouds["radar"])
    assert (path / "000000" / "lidar.npz").is_file()


@pytest.mark.parametrize("name", ["out.mcap", "out.ros2", "out"])
def test_an_empty_cloud_is_written(tmp_path, name):
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    empty = PointCloud(np.zeros((4, 3), np.float32), np.zeros(4, bool))
    write(tmp_path / name, [VIEWS[0]._replace(clouds={"enhanced": empty})])
    assert (tmp_path / name).exists()


@pytest.mark.parametrize("name", ["out.mcap", "out.ros2"])
def test_a_full_disk_is_named(small_disk, name, monkeypatch):
    writers = pytest.importorskip("jradar.stream.foxglove_writers")
    monkeypatch.setattr(writers, "FLUSHED_S", 0.0)
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    writer = open_writer(small_disk / name)
    with pytest.raises(OSError, match=rf"{name} cannot be written .*the disk full"):
        for _ in range(100):
            writer.write(view_of(0, points=5000))
    with contextlib.suppress(OSError):
        writer.close()


@pytest.mark.parametrize("name", ["out.mcap", "out.ros2"])
def test_a_recording_is_never_overwritten(tmp_path, name):
    (tmp_path / name).mkdir()
    with pytest.raises(UsageError, match="exists and is not overwritten"):
        open_writer(tmp_path / name)


def test_a_name_of_no_known_kind_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"expected a file \.mcap, a ROS 2 bag"):
        open_writer(tmp_path / "out.bag")


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    for package, name, extra in (
        ("foxglove", "out.mcap", "live"),
        ("rosbags.rosbag2", "out.ros2", "ros"),
    ):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(ImportError, match=rf"pip install 'jradar\[{extra}\]'"):
            open_writer(tmp_path / name)


def test_every_field_that_a_cloud_has_is_a_column():
    cloud = VIEWS[0].clouds["radar"]
    assert point_table(cloud).dtype.names == (*"xyz", "velocity", "power")
    bare = cloud._replace(velocity=None, power=None)
    assert point_table(bare).dtype.names == (*"xyz",)


KILLED = """
import os, signal, sys
from tests.stream.scenes import view_of
from jradar.stream import foxglove_writers
foxglove_writers.FLUSHED_S = 0.0
writer = foxglove_writers.McapWriter(sys.argv[1])
for number in range(40):
    writer.write(view_of(number, points=500))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_an_mcap_file_of_a_killed_program_is_read_up_to_its_last_chunk(tmp_path):
    pytest.importorskip("foxglove")
    reading = pytest.importorskip("mcap.stream_reader")
    records = pytest.importorskip("mcap.records")
    exceptions = pytest.importorskip("mcap.exceptions")
    path = tmp_path / "out.mcap"
    done = subprocess.run([sys.executable, "-c", KILLED, path], capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    times = []
    with path.open("rb") as file:
        try:
            for record in reading.StreamReader(file).records:
                if isinstance(record, records.Message):
                    times.append(record.log_time)
        except (exceptions.McapError, struct.error, EOFError):
            pass
    expected = [view_of(number, points=1).stamp_ns for number in range(40)]
    assert sorted({*times}) == expected and len(times) == 4 * 40


async def receive(port, count):
    """Subscribe to all topics of a server; return `count` messages by topic."""
    from websockets.asyncio.client import connect

    options = {"subprotocols": ["foxglove.sdk.v1"], "max_size": None}
    async with connect(f"ws://127.0.0.1:{port}", **options) as socket:
        channels, found = {}, {}
        while sum(map(len, found.values())) < count:
            message = await asyncio.wait_for(socket.recv(), 60)
            if isinstance(message, str):
                told = json.loads(message)
                if told["op"] == "advertise":
                    new = {c["id"]: c for c in told["channels"]}
                    wanted = [{"id": i, "channelId": i} for i in new]
                    channels |= new
                    await socket.send(
                        json.dumps({"op": "subscribe", "subscriptions": wanted})
                    )
            elif message[0] == 1:
                subscription, time_ns = struct.unpack_from("<IQ", message, 1)
                topic = channels[subscription]["topic"]
                found.setdefault(topic, []).append((time_ns, message[13:]))
        return found


@pytest.mark.flaky(reruns=2, reruns_delay=5)  # a server in a thread, with timeouts
def test_a_viewer_receives_clouds_over_the_websocket():
    pytest.importorskip("foxglove")
    pytest.importorskip("websockets")
    from jradar.stream.foxglove_writers import Server

    server, ending = Server(port=0), threading.Event()

    def publish():
        while not ending.is_set():
            server.write(VIEWS[1])
            time.sleep(0.02)

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        found = asyncio.run(receive(server.port, 12))
    finally:
        ending.set()
        thread.join()
        server.close()
    time_ns, raw = found["/radar/points"][0]
    assert time_ns == VIEWS[1].stamp_ns
    table = point_table(VIEWS[1].clouds["radar"]).tobytes()
    assert table in bytes(raw)


def test_a_taken_port_of_the_server_is_named():
    pytest.importorskip("foxglove")
    from jradar.stream.foxglove_writers import Server

    server = Server(port=0)
    try:
        with pytest.raises(OSError, match="Name another with --serve PORT"):
            Server(port=server.port)
    finally:
        server.close()


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
