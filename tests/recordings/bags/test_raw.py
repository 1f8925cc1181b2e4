"""Raw samples in ROS bags: the messages of xwr_ros and of iwr_raw_rosnode."""

import numpy as np
import pytest

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="pip install 'jradar[ros]'")
from rosbags import rosbag2  # noqa: E402
from rosbags.typesys import (  # noqa: E402
    Stores,
    get_types_from_msg,
    get_typestore,
)

from jradar.errors import UsageError  # noqa: E402
from jradar.recordings import is_recording, open_recording  # noqa: E402
from tests.recordings.bag_writer import CLOUD  # noqa: E402
from tests.recordings.dca1000_writer import (  # noqa: E402
    CFG,
    as_bytes,
    random_cubes,
)

START = 1_700_000_000 * 10**9
TENTH = 10**8
IQ, FRAME, ARRAY = (
    *("xwr_msgs/msg/IQ", "mmWave/msg/data_frame"),
    "std_msgs/msg/Int16MultiArray",
)
TEXTS = {
    IQ: "std_msgs/Header header\n\nstd_msgs/Int16MultiArray iq # raw\nbool complete\n",
    FRAME: "int16[] data\n",
}
CUBES = random_cubes(3)
WORDS = [np.frombuffer(as_bytes([cube]), "<i2") for cube in CUBES]


def message_of(store, kind, words, time_ns):
    if kind == FRAME:
        return store.types[kind](data=words)
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    array = store.types[ARRAY](layout=layout, data=words)
    if kind == ARRAY:
        return array
    seconds, rest = divmod(time_ns, 10**9)
    stamp = store.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
    header = {"stamp": stamp, "frame_id": "xwr"}
    if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__:
        header["seq"] = 0
    header = store.types["std_msgs/msg/Header"](**header)
    return store.types[kind](header=header, iq=array, complete=True)


def write(folder, kind, *, ros1, topics=("/radar",), words=WORDS):
    """A bag whose messages were recorded 20 ms after their stamps."""
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if kind in TEXTS:
        store.register(get_types_from_msg(TEXTS[kind], kind))
    (folder / "profile.cfg").write_text(CFG)
    path = folder / ("raw.bag" if ros1 else "raw")
    writer = rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=8)
    encode = store.serialize_ros1 if ros1 else store.serialize_cdr
    with writer:
        for topic in topics:
            connection = writer.add_connection(topic, kind, typestore=store)
            for number, frame in enumerate(words):
                time_ns = START + number * TENTH
                raw = bytes(encode(message_of(store, kind, frame, time_ns), kind))
                writer.write(connection, time_ns + TENTH // 5, raw)
    return path


@pytest.mark.parametrize("ros1", [True, False])
@pytest.mark.parametrize("kind", [IQ, FRAME, ARRAY])
def test_frames_and_their_times_come_back(tmp_path, kind, ros1):
    recording = open_recording(write(tmp_path, kind, ros1=ros1))
    np.testing.assert_array_equal([*recording.cubes], CUBES)
    late = 0.0 if kind == IQ else 0.02
    expected = 1.7e9 + late + 0.1 * np.arange(3)
    np.testing.assert_allclose(recording.cubes.stamps, expected, atol=1e-6)
    assert any("on the topic /radar" in note for note in recording.notes)


def test_another_order_of_i_and_q_is_taken(tmp_path):
    words = [np.frombuffer(as_bytes([cube], "QQII"), "<i2") for cube in CUBES]
    path = write(tmp_path, IQ, ros1=True, words=words)
    recording = open_recording(path, iq_order="QQII")
    np.testing.assert_array_equal([*recording.cubes], CUBES)


def test_messages_of_another_size_are_refused(tmp_path):
    path = write(tmp_path, IQ, ros1=True, words=[WORDS[0][:-2]])
    with pytest.raises(ValueError, match=r"holds 1,198 numbers, .* needs 1,200"):
        open_recording(path)


def test_two_topics_of_samples_are_refused(tmp_path):
    path = write(tmp_path, IQ, ros1=True, topics=("/left", "/right"))
    with pytest.raises(UsageError, match=r"2 topics hold raw samples \(/left, /right"):
        open_recording(path)


def test_bags_of_clouds_are_no_recordings_of_a_radar(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(tmp_path / "clouds", version=8) as writer:
        writer.add_connection("/points", CLOUD, typestore=store)
    assert not is_recording(tmp_path / "clouds")
    (tmp_path / "empty.bag").write_bytes(b"")
    assert not is_recording(tmp_path / "empty.bag")
