"""Topics, frame ids, stamps, motion and QoS, as the readers of others find them."""

import time
from pathlib import Path

import numpy as np
import pytest

from jradar.lidar import Poses, rigid_transform
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream
from jradar.stream.outputs import open_writer
from jradar.stream.processing import Processor
from jradar.stream.views import recorded_view
from tests.stream.scenes import cloud_of
from tests.stream.test_live import CUBES, POINTS, RECORDING, Kept, play

RADAR = RadarSpec.awr1843(num_chirps=4, num_samples=32)
CUBE = np.zeros(RADAR.cube_shape, np.complex64)
STAMPS = 1_700_000_000.5 + 0.25 * np.arange(4)
TIMES = STAMPS[0] - 0.1 + 0.2 * np.arange(5)  # they end before the last frame
TURNED = [0, 0, 0.6, 0.8]
BASE_FROM = {
    "radar": rigid_transform(np.array([0.1, 0.2, 0.3]), np.array(TURNED)),
    "lidar": rigid_transform(np.array([0.0, 0, 1]), np.array([0, 0, 0, 1.0])),
}
WALK = Recording(
    "walk",
    Path("walk"),
    Radar(RADAR),
    Stream(lambda number: CUBE, 4, STAMPS),
    poses=Poses(
        TIMES,
        np.stack([2 * (TIMES - STAMPS[0]), 0 * TIMES, 0 * TIMES + 1], 1),
        np.tile([0.0, 0, 0, 1], (5, 1)),
    ),
    base_from_radar=BASE_FROM["radar"],
    base_from_lidar=BASE_FROM["lidar"],
)
TOPICS = {
    "/radar/points": "PointCloud",
    "/enhanced/points": "PointCloud",
    "/lidar/points": "PointCloud",
    "/radar/range_azimuth": "Image",
    "/tf": "Transforms",
}


def published(path, recording=WALK):
    """Write all frames of a recording."""
    writer = open_writer(path)
    for frame in range(len(recording.cubes)):
        clouds = {name: cloud_of(5) for name in ("radar", "enhanced", "lidar")}
        picture = np.zeros((6, 4), np.uint8)
        writer.write(recorded_view(recording, frame, clouds, picture))
    writer.close()
    return path


def bag_messages(path):
    """Topic, type, time, stamp, frame ids and transforms, by rosbags."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            transforms = getattr(message, "transforms", None)
            headers = [one.header for one in transforms or [message]]
            found = [
                (
                    *(one.header.frame_id, one.child_frame_id),
                    one.transform.translation,
                    one.transform.rotation,
                )
                for one in transforms or []
            ]
            stamps = {h.stamp.sec * 10**9 + h.stamp.nanosec for h in headers}
            frames = {h.frame_id for h in headers}
            yield connection.topic, connection.msgtype, time_ns, stamps, frames, found


def mcap_messages(path):
    """The same of an MCAP file, by the package of its authors."""
    pytest.importorskip("foxglove")
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    with path.open("rb") as file:
        made = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, raw, message in made.iter_decoded_messages():
            transforms = getattr(message, "transforms", None)
            found = [
                (
                    *(one.parent_frame_id, one.child_frame_id),
                    one.translation,
                    one.rotation,
                )
                for one in transforms or []
            ]
            stamps = {one.timestamp.ToNanoseconds() for one in transforms or [message]}
            frames = {one[0] for one in found} or {message.frame_id}
            yield channel.topic, schema.name, raw.log_time, stamps, frames, found


READERS = {"out.ros2": bag_messages, "out.mcap": mcap_messages}


@pytest.fixture(params=READERS)
def messages(request, tmp_path):
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    return [*READERS[request.param](published(tmp_path / request.param))]


def test_topics_have_their_types_and_all_but_tf_the_radars_frame(messages):
    kinds = {topic: kind for topic, kind, *_ in messages}
    assert kinds.keys() == TOPICS.keys()
    for topic, kind in TOPICS.items():
        assert kind.replace("Transforms", "") in kinds[topic]
    for topic, *_, frames, _ in messages:
        assert frames <= {"odom", "base"} if topic == "/tf" else frames == {"radar"}


def test_all_of_a_frame_have_its_recorded_stamp(messages):
    expected = [round(stamp * 1e9) for stamp in STAMPS]
    for topic in TOPICS:
        rows = [row for row in messages if row[0] == topic]
        assert [time_ns for _, _, time_ns, *_ in rows] == expected
        assert [stamps for _, _, _, stamps, *_ in rows] == [{one} for one in expected]


def test_the_base_moves_in_odom_as_recorded(messages):
    tf = [found for topic, *_, found in messages if topic == "/tf"]
    for number, found in enumerate(tf):
        placed = {(parent, child): rest for parent, child, *rest in found}
        known = {("base", "radar"), ("base", "lidar")}
        known |= {("odom", "base")} if number < 3 else set()
        assert placed.keys() == known
        place, turn = placed["base", "radar"]
        np.testing.assert_allclose(
            [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w],
            [0.1, 0.2, 0.3, *TURNED],
            atol=1e-12,
        )
        if number < 3:
            place, _ = placed["odom", "base"]
            moved = 2 * (STAMPS[number] - STAMPS[0])
            np.testing.assert_allclose([place.x, place.y, place.z], [moved, 0, 1])


def test_a_bags_topics_are_offered_as_ros_does_by_default(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([published(tmp_path / "out.ros2")]) as reader:
        assert len(reader.connections) == len(TOPICS)
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            words = qos.reliability.name, qos.durability.name, qos.history.name
            assert words == ("RELIABLE", "VOLATILE", "KEEP_LAST") and qos.depth == 10


@pytest.mark.parametrize("change", ["no poses", "no stamps", "one pose"])
def test_without_known_motion_there_is_no_odom(tmp_path, change):
    pytest.importorskip("rosbags")
    recording = {
        "no poses": WALK._replace(poses=None),
        "no stamps": WALK._replace(cubes=Stream(lambda number: CUBE, 4)),
        "one pose": WALK._replace(poses=Poses(*(part[:1] for part in WALK.poses))),
    }[change]
    rows = [*bag_messages(published(tmp_path / "out.ros2", recording))]
    assert {"base"} in [frames for topic, *_, frames, _ in rows if topic == "/tf"]
    assert not any("odom" in frames for *_, frames, _ in rows)
    if change == "no stamps":
        period_s = RADAR.frame_period_s or 0.1
        times = [time_ns for topic, _, time_ns, *_ in rows if topic == "/tf"]
        assert times == [round(n * period_s * 1e9) for n in range(4)]


def test_a_replayed_frame_moves_as_recorded():
    view = Processor(WALK).view(CUBE, 5, 7.0)
    assert view.stamp_s == 7 and view.odom_from_base[0, 3] == pytest.approx(2 * 0.25)


def test_a_live_frame_has_the_time_of_its_arrival():
    kept, begin_s = Kept(), time.time()
    play(Processor(RECORDING, points=POINTS), kept)
    stamps = [view.stamp_s for view in kept.views]
    assert len(stamps) == len(CUBES) and stamps == sorted(stamps)
    assert begin_s < stamps[0] and stamps[-1] < time.time()
