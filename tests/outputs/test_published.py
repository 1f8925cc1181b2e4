"""Topics, frame ids, stamps, motion and QoS, as the readers of others find them."""

import time
from pathlib import Path

import numpy as np
import pytest

from jradar.lidar import Poses
from jradar.outputs.published import published
from jradar.outputs.writers import open_writer
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream
from jradar.stream.processing import Processor
from tests.outputs.readers import READERS, bag_messages
from tests.outputs.scenes import BASE_FROM, cloud_of, columns_of, frame_of
from tests.stream.test_live import CUBES, POINTS, RECORDING, Kept, play

RADAR = RadarSpec.awr1843(num_chirps=4, num_samples=32)
CUBE = np.zeros(RADAR.cube_shape, np.complex64)
STAMPS = 1_700_000_000.5 + 0.25 * np.arange(4)
TIMES = STAMPS[0] - 0.1 + 0.2 * np.arange(5)  # they end before the last frame
POSES = Poses(
    TIMES,
    np.stack([2 * (TIMES - STAMPS[0]), 0 * TIMES, 0 * TIMES + 1], 1),
    np.tile([0.0, 0, 0, 1], (5, 1)),
)
PLACES = {f"base_from_{sensor}": place for sensor, place in BASE_FROM.items()}
FOUR = Stream(lambda number: CUBE, 4, STAMPS)
WALK = Recording("walk", Path("walk"), Radar(RADAR), FOUR, poses=POSES, **PLACES)
TOPICS = {
    "/radar/points": "PointCloud",
    "/enhanced/points": "PointCloud",
    "/lidar/points": "PointCloud",
    "/radar/range_azimuth": "Image",
    "/tf": "Transforms",
}


def contents_of(frame):
    """The clouds and the picture of a frame."""
    held = frame_of(frame)
    return held.clouds | {"enhanced": cloud_of(80, seed=9 + frame)}, held.picture


def written(path, recording=WALK):
    """Write all frames of a recording."""
    writer = open_writer(path)
    for frame in range(len(recording.cubes)):
        writer.write(published(recording, frame, *contents_of(frame)))
    writer.close()
    return path


@pytest.fixture(scope="module", params=READERS)
def messages(request, tmp_path_factory):
    """All messages of an output, by topic."""
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    path, found = tmp_path_factory.mktemp("out") / request.param, {}
    for message in READERS[request.param](written(path)):
        found.setdefault(message.topic, []).append(message)
    return found


def test_topics_have_their_types_and_all_but_tf_the_radars_frame(messages):
    assert messages.keys() == TOPICS.keys()
    for topic, found in messages.items():
        for message in found:
            assert TOPICS[topic].replace("Transforms", "") in message.kind
            base = topic == "/tf"
            assert message.frames <= ({"odom", "base"} if base else {"radar"})


def test_all_of_a_frame_have_its_recorded_stamp(messages):
    expected = [round(stamp * 1e9) for stamp in STAMPS]
    for found in messages.values():
        assert [message.time_ns for message in found] == expected
        assert [message.stamps for message in found] == [{one} for one in expected]


def test_every_number_of_a_cloud_and_a_picture_is_read_back(messages):
    for frame in range(4):
        clouds, picture = contents_of(frame)
        for name, cloud in clouds.items():
            found = messages[f"/{name}/points"][frame].content
            np.testing.assert_equal(found, columns_of(cloud))
        found = messages["/radar/range_azimuth"][frame].content
        np.testing.assert_array_equal(found, picture)


def test_the_base_moves_in_odom_as_recorded(messages):
    known = {("base", "radar"): [0.1, 0.2, 0.3, 0, 0, 0.6, 0.8]}
    known |= {("base", "lidar"): [0, 0, 1, 0, 0, 0, 1]}
    for number, message in enumerate(messages["/tf"]):
        moved = 2 * (STAMPS[number] - STAMPS[0])
        moving = {("odom", "base"): [moved, 0, 1, 0, 0, 0, 1]} if number < 3 else {}
        assert message.content.keys() == (known | moving).keys()
        for pair, place in (known | moving).items():
            np.testing.assert_allclose(message.content[pair], place, atol=1e-9)


def test_a_bags_topics_are_offered_as_ros_does_by_default(tmp_path):
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([written(tmp_path / "out.ros2")]) as reader:
        assert len(reader.connections) == len(TOPICS)
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles
            words = qos.reliability.name, qos.durability.name, qos.history.name
            assert words == ("RELIABLE", "VOLATILE", "KEEP_LAST") and qos.depth == 10


@pytest.mark.parametrize(
    "change",
    [
        {"poses": None},
        {"poses": Poses(*(part[:1] for part in POSES))},
        {"cubes": Stream(lambda number: CUBE, 4)},  # without stamps
    ],
    ids=["no poses", "one pose", "no stamps"],
)
def test_without_known_motion_there_is_no_odom(tmp_path, change):
    pytest.importorskip("rosbags")
    path = written(tmp_path / "out.ros2", WALK._replace(**change))
    rows = [row for row in bag_messages(path) if row.topic == "/tf"]
    assert all(row.frames == {"base"} for row in rows)
    if "cubes" in change:
        period_s = RADAR.frame_period_s or 0.1
        expected = [round(n * period_s * 1e9) for n in range(4)]
        assert [row.time_ns for row in rows] == expected


def test_a_replayed_frame_moves_as_recorded():
    shown = Processor(WALK).published(CUBE, 5, 7.0)
    assert shown.stamp_s == 7 and shown.odom_from_base[0, 3] == pytest.approx(2 * 0.25)


def test_a_live_frame_has_the_time_of_its_arrival():
    kept, begin_s = Kept(), time.time()
    play(Processor(RECORDING, points=POINTS), kept)
    stamps = [frame.stamp_s for frame in kept.frames]
    assert len(stamps) == len(CUBES) and stamps == sorted(stamps)
    assert begin_s < stamps[0] and stamps[-1] < time.time()


@pytest.mark.parametrize("name", ["out.mcap", "out.ros2"])
def test_the_verdict_of_a_frame_is_a_message(tmp_path, name):
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    from mcap.reader import make_reader

    verdicts = ("66% of its points may be right",), ("9% of", "do not trust frame 1")
    writer = open_writer(tmp_path / name)
    for frame, verdict in enumerate(verdicts):
        shown = published(WALK, frame, *contents_of(frame))
        writer.write(shown._replace(verdict=verdict))
    writer.close()
    path = tmp_path / name
    (path,) = [path] if path.is_file() else path.glob("*.mcap")
    with path.open("rb") as file:
        found = [*make_reader(file).iter_messages(topics=["/enhanced/verdict"])]
    for (schema, _, message), verdict in zip(found, verdicts, strict=True):
        assert schema.name in ("foxglove.Log", "rcl_interfaces/msg/Log")
        assert "; ".join(verdict).encode() in message.data
