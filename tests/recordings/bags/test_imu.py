"""IMUs: messages in ROS 1 and ROS 2 bags, units, places."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")

from jradar.errors import UsageError  # noqa: E402
from jradar.recordings.bags.bags import open_imu  # noqa: E402
from jradar.recordings.capture import open_capture  # noqa: E402
from tests.recordings.bag_writer import IMU, START, imu, write_bag  # noqa: E402
from tests.recordings.test_capture import (  # noqa: E402
    CAPTURE,
    describe,
    folder as folder,
    written as written,
)

RECORDS = np.arange(60).reshape(10, 6) / 10 + [0, 0, 9.8, 0, 0, 0]
STAMPS = START / 1e9 + 0.01 * np.arange(10)


def write(folder, container="bag", records=RECORDS):
    stamps = range(START, START + 10**8, 10**7)
    each = zip(stamps, records, strict=True)
    messages = [("/imu", IMU, stamp, imu(record, stamp)) for stamp, record in each]
    return write_bag(folder, container, messages)


@pytest.mark.parametrize("container", ["bag", "sqlite"])
def test_messages_in_a_bag(tmp_path, container):
    path = write(tmp_path, container)
    imu, notes = open_imu(path)
    np.testing.assert_allclose(imu.stamps, STAMPS)
    np.testing.assert_allclose(np.hstack([imu.force, imu.rate]), RECORDS)
    assert notes == ()
    with pytest.raises(UsageError, match="no sensor_msgs/msg/Imu on /other"):
        open_imu(path, topic="/other")


def test_forces_in_units_of_gravity_are_converted(tmp_path):
    records = np.tile([0.0, 0.0, 1.0, 0.1, 0.2, 0.3], (10, 1))
    imu, notes = open_imu(write(tmp_path, records=records))
    np.testing.assert_allclose(imu.force, np.tile([0, 0, 9.80665], (10, 1)))
    assert "are in g" in notes[0]


def test_a_capture_names_its_imu_and_its_place(folder):  # noqa: F811
    write(folder)
    table = '\n[imu]\nfile = "a.bag"\nrpy_degrees = [0, 0, 90]\n'
    recording = open_capture(describe(folder, text=CAPTURE + table))
    np.testing.assert_allclose(recording.imu.stamps, STAMPS)
    moved = recording.base_from_imu[:3, :3] @ [1, 0, 0]
    np.testing.assert_allclose(moved, [0, 1, 0], atol=1e-12)
