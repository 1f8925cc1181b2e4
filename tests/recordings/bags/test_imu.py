"""IMUs: ColoRadar's text files, messages in ROS 1 and ROS 2 bags, units, places."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import open_imu
from jradar.recordings.capture import open_capture
from jradar.recordings.imu import read_imu
from jradar.simulation.coloradar_writer import write_rows, write_stamps
from tests.recordings.test_capture import CAPTURE, describe, folder, written

__all__ = ["folder", "written"]  # fixtures

RECORDS = np.arange(60).reshape(10, 6) / 10 + [0, 0, 9.8, 0, 0, 0]
STAMPS = 1000 + 0.01 * np.arange(10)
IMU = """
[imu]
file = "imu.bag"
rpy_degrees = [0, 0, 90]
"""


def test_coloradars_files(tmp_path):
    notes = []
    write_stamps(tmp_path / "imu", STAMPS)
    write_rows(tmp_path / "imu" / "imu_data.txt", RECORDS[:9])
    imu = read_imu(tmp_path / "imu", notes)
    np.testing.assert_allclose(imu.stamps, STAMPS[:9])
    np.testing.assert_allclose(np.hstack([imu.force, imu.rate]), RECORDS[:9])
    assert "10 stamps for 9 lines" in notes[0]


def write_bag(path, records):
    pytest.importorskip("rosbags", reason="pip install jradar[ros]")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    is_ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    writer = rosbag1.Writer(path) if is_ros1 else rosbag2.Writer(path, version=9)
    kind, types = "sensor_msgs/msg/Imu", store.types
    vector = types["geometry_msgs/msg/Vector3"]
    with writer as bag:
        topic = bag.add_connection("/imu", kind, typestore=store)
        for stamp, record in zip(STAMPS, records, strict=True):
            stamp_ns = round(stamp * 1e9)
            time = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
            sequence = {"seq": 0} if is_ros1 else {}
            message = types[kind](
                header=types["std_msgs/msg/Header"](
                    **sequence, stamp=time, frame_id="base"
                ),
                orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                orientation_covariance=np.full(9, -1.0),
                angular_velocity=vector(*record[3:].tolist()),
                angular_velocity_covariance=np.full(9, -2.0),
                linear_acceleration=vector(*record[:3].tolist()),
                linear_acceleration_covariance=np.full(9, -3.0),
            )
            write = store.serialize_ros1 if is_ros1 else store.serialize_cdr
            bag.write(topic, stamp_ns, write(message, kind))
    return path


@pytest.mark.parametrize("name", ["imu.bag", "imu"])
def test_messages_in_a_bag(tmp_path, name):
    imu, notes = open_imu(write_bag(tmp_path / name, RECORDS))
    np.testing.assert_allclose(imu.stamps, STAMPS)
    np.testing.assert_allclose(np.hstack([imu.force, imu.rate]), RECORDS)
    assert notes == ()
    with pytest.raises(UsageError, match="no sensor_msgs/msg/Imu on /other"):
        open_imu(tmp_path / name, topic="/other")


def test_forces_in_units_of_gravity_are_converted(tmp_path):
    records = np.tile([0.0, 0.0, 1.0, 0.1, 0.2, 0.3], (10, 1))
    imu, notes = open_imu(write_bag(tmp_path / "imu.bag", records))
    np.testing.assert_allclose(imu.force, np.tile([0, 0, 9.80665], (10, 1)))
    assert "are in g" in notes[0]


def test_a_capture_names_its_imu_and_its_place(folder):  # noqa: F811
    write_bag(folder / "imu.bag", RECORDS)
    recording = open_capture(describe(folder, text=CAPTURE + IMU))
    np.testing.assert_allclose(recording.imu.stamps, STAMPS)
    np.testing.assert_allclose(
        recording.base_from_imu[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12
    )
