"""Captures: samples and radar come back from the card's file, scans from the bag."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.radar import RadarSpec
from jradar.recordings import read_description
from jradar.recordings.capture import open_capture
from jradar.recordings.ti.dca1000 import open_dca1000
from jradar.simulation.capture_writer import dca1000_bytes, simulate_capture, write_cfg
from jradar.simulation.rig import EXTRINSICS

RADAR = RadarSpec.awr1843()


def test_samples_come_back_through_the_cfg_and_the_order_of_the_card(tmp_path):
    write_cfg(tmp_path / "awr1843.cfg", RADAR)
    radar = read_description(tmp_path / "awr1843.cfg").radar
    assert radar.cube_shape == RADAR.cube_shape
    assert radar.tx_positions == RADAR.tx_positions
    assert radar.max_velocity_mps == pytest.approx(RADAR.max_velocity_mps)
    assert radar.range_resolution_m == pytest.approx(RADAR.range_resolution_m)
    random = np.random.default_rng(0)
    frame = random.integers(-99, 99, (*RADAR.cube_shape, 2)).astype(np.int16)
    (tmp_path / "adc_data.bin").write_bytes(dca1000_bytes(frame))
    recording = open_dca1000(tmp_path / "adc_data.bin", tmp_path / "awr1843.cfg")
    cube = recording.cubes[0]
    np.testing.assert_array_equal(cube, frame[..., 0] + 1j * frame[..., 1])


def test_a_capture_holds_a_bag_of_the_livox(scene_built_once, tmp_path):
    reader = pytest.importorskip("rosbags.highlevel")
    capture = simulate_capture("corridor", 5, tmp_path, frames=1)
    assert (capture / "adc_data.bin").stat().st_size == 786_432
    with reader.AnyReader([capture / "lidar.bag"]) as bag:
        kinds = {c.topic: (c.msgtype, c.msgcount) for c in bag.connections}
        assert kinds["/livox/lidar"] == ("livox_ros_driver2/msg/CustomMsg", 1)
        connection = next(c for c in bag.connections if c.topic == "/livox/lidar")
        _, stamp, raw = next(bag.messages([connection]))
        message = bag.deserialize(raw, connection.msgtype)
    assert message.point_num == len(message.points) == 20_000
    assert message.timebase == stamp and message.points[-1].offset_time < 1e8
    some = np.array([(p.x, p.y, p.z) for p in message.points])
    assert 0.5 < (some != 0).any(-1).mean() <= 1
    recording = open_capture(capture)
    assert recording.cubes[0].shape == RADAR.cube_shape
    start = np.loadtxt(capture / "timestamps.txt")
    np.testing.assert_allclose(recording.cubes.stamps[0], start, atol=1e-4)
    assert 0.5 * 20_000 < len(recording.lidar[0]) <= 20_000
    first, last = recording.poses.stamps[[0, -1]]
    assert first < start < last
    calib = np.array(EXTRINSICS["livox"][0])
    np.testing.assert_allclose(recording.base_from_lidar[:3, 3], calib)


def test_frames_of_a_capture_can_be_farther_apart(scene_built_once, tmp_path):
    pytest.importorskip("rosbags")
    with pytest.raises(UsageError, match=r"period_s = 0\.25, expected a multiple"):
        simulate_capture("corridor", 5, tmp_path, frames=2, period_s=0.25)
    capture = simulate_capture("corridor", 5, tmp_path, frames=2, period_s=0.5)
    recording = open_capture(capture)
    start = np.loadtxt(capture / "timestamps.txt")
    np.testing.assert_allclose(recording.cubes.stamps, start, atol=5e-3)
    np.testing.assert_allclose(np.diff(start), [0.5], atol=5e-3)
    np.testing.assert_allclose(np.diff(recording.lidar.stamps), [0.5], atol=5e-3)
    assert recording.poses.stamps[-1] > start[-1]
