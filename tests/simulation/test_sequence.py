"""Sequences on disk: layout, sizes, calibration, same bytes again, never half."""

import subprocess
import sys
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.lidar import rigid_transform, transform
from jradar.radar import (
    RadarSpec,
    Scatterers,
    range_doppler,
    simulate_cube,
    subtract_coupling,
)
from jradar.recordings import (
    radar_from_cfg,
    radar_from_coloradar,
    read_coupling,
    read_frequency_phase,
)
from jradar.recordings.capture import open_capture
from jradar.recordings.dca1000 import open_dca1000
from jradar.simulation import (
    SETS,
    check_set,
    simulate,
    simulate_sequence,
    simulate_set,
)
from jradar.simulation.capture_writer import dca1000_bytes, simulate_capture, write_cfg
from jradar.simulation.coloradar_writer import write_calib
from jradar.simulation.hardware import channel_factors, make_hardware
from jradar.simulation.rig import EXTRINSICS
from jradar.simulation.sequence import EPOCH_S, imu_records, make_setting
from jradar.simulation.sets import (
    folder_digest,
    read_manifest,
    set_sequences,
)
from tests.simulation.test_echoes import paths_of
from tests.simulation.worlds import straight

RADAR = RadarSpec.awr1843()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return simulate_sequence("corridor", 5, tmp_path_factory.mktemp("sim"), frames=2)


def test_files_have_coloradars_names_and_sizes(folder):
    for sensor, name, size in (
        ("single_chip/adc_samples", "data/frame_{}.bin", 786_432),
        ("lidar", "pointclouds/lidar_pointcloud_{}.bin", 1_048_576),
    ):
        stamps = np.loadtxt(folder / sensor / "timestamps.txt")
        assert len(stamps) == 2 and 0.09 < stamps[1] - stamps[0] < 0.11
        for k in range(2):
            assert (folder / sensor / name.format(k)).stat().st_size == size
    stamps = np.loadtxt(folder / "groundtruth" / "timestamps.txt")
    poses = np.loadtxt(folder / "groundtruth" / "groundtruth_poses.txt")
    assert poses.shape == (len(stamps), 7)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=-1), 1, atol=1e-6)
    assert stamps[0] < EPOCH_S + 0.06 and stamps[-1] > EPOCH_S + 0.25
    imu = np.loadtxt(folder / "imu" / "imu_data.txt")
    assert imu.shape == (len(np.loadtxt(folder / "imu" / "timestamps.txt")), 6)


def test_the_calib_folder_says_what_was_simulated(folder):
    calib = folder.parent / "calib"
    for name, radar in (("single_chip", RADAR), ("cascade", RadarSpec.cascade())):
        read = radar_from_coloradar(calib / name)
        for field in ("tx_positions", "rx_positions", "tx_firing_order", "cube_shape"):
            assert getattr(read, field) == getattr(radar, field)
        for field in ("start_frequency_hz", "slope_hz_per_s", "chirp_period_s"):
            assert getattr(read, field) == pytest.approx(
                getattr(radar, field), rel=1e-9
            )
        assert read_coupling(calib / name / "coupling_calib.txt").shape == (
            *radar.cube_shape[:2],
            radar.num_samples // 2,
        )
    hardware = make_hardware("cascade", RadarSpec.cascade())
    measured = read_frequency_phase(calib / "cascade" / "phase_frequency_calib.txt")
    np.testing.assert_allclose(measured.frequency - 100, hardware.frequency, atol=1e-6)
    np.testing.assert_allclose(measured.phase, hardware.phase, atol=1e-6)
    radar, lidar = (
        rigid_transform(*(np.array(line.split(), float) for line in pose.splitlines()))
        for pose in (
            (calib / "transforms" / f"base_to_{sensor}.txt").read_text()
            for sensor in ("single_chip", "lidar")
        )
    )
    found = transform(np.linalg.inv(radar) @ lidar, np.array([[-3.0, 0, 0]]))
    np.testing.assert_allclose(found, [[2.888, -0.190, 0.061]], atol=1e-3)


def test_the_coupling_file_removes_the_leakage(folder):
    coupling = read_coupling(folder.parent / "calib/single_chip/coupling_calib.txt")
    hardware = make_hardware("single_chip", RADAR)
    leakage = hardware.leakage * channel_factors(hardware, RADAR)
    cube = np.broadcast_to(leakage[:, :, None], RADAR.cube_shape)
    spectrum, power = range_doppler(
        jnp.asarray(cube, jnp.complex64), range_window="blackman"
    )
    left = subtract_coupling(spectrum, jnp.asarray(coupling, jnp.complex64))
    left = (np.abs(left[..., 1:65]) ** 2).sum(0)
    assert left.max() < 1e-6 * np.asarray(power)[:, 1:65].max()


def test_a_real_calib_folder_is_not_replaced(tmp_path):
    (tmp_path / "calib").mkdir()
    with pytest.raises(ValueError, match="not simulated"):
        write_calib(tmp_path / "calib", {})


def test_the_same_seed_gives_the_same_bytes_in_another_process(folder, tmp_path):
    code = (
        "from jradar.simulation import simulate_sequence as s; "
        f"s('corridor', 5, {str(tmp_path)!r}, frames=2)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert folder_digest(tmp_path / "corridor_5") == folder_digest(folder)
    assert folder_digest(tmp_path / "calib") == folder_digest(folder.parent / "calib")


def test_an_interrupted_run_leaves_nothing_half_written(tmp_path):
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_sequence("corridor", 5, tmp_path, frames=2, advance=interrupt)
    assert [p.name for p in tmp_path.iterdir()] == ["calib"]


def test_capture_order_is_what_the_cfg_and_the_card_say(tmp_path):
    write_cfg(tmp_path / "awr1843.cfg", RADAR, frame_period_s=0.1)
    radar = radar_from_cfg(tmp_path / "awr1843.cfg")
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


def test_a_capture_holds_a_bag_of_the_livox(tmp_path):
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


def test_a_resting_imu_feels_gravity_alone():
    setting = make_setting("corridor", 5)
    scene = setting.scene._replace(platform=straight())
    records = imu_records(setting._replace(scene=scene), np.arange(200) / 300)
    assert np.linalg.norm(records[:, :3].mean(0)) == pytest.approx(9.81, abs=0.1)
    assert np.abs(records[:, 3:].mean(0)).max() < 0.01


def test_gradients_through_a_frame_are_finite():
    setting = make_setting("corridor", 5)
    paths = paths_of(setting.scene, setting.reflectors, 0.5)
    columns = (paths.xyz, paths.velocity, np.sqrt(paths.power), paths.departure)
    few = Scatterers(*(jnp.asarray(column[:32], jnp.float32) for column in columns))
    radar = RadarSpec.awr1843(num_chirps=8)
    key = jax.random.key(0)
    gradient = jax.grad(lambda s: jnp.abs(simulate_cube(key, s, radar)).sum())(few)
    assert all(bool(jnp.isfinite(g).all()) for g in gradient)


def test_splits_share_no_layout_and_the_manifest_finds_a_changed_file(
    tmp_path, monkeypatch
):
    scenes = [pair for _, *pair in set_sequences("jradar-sim")]
    assert len({tuple(pair) for pair in scenes}) == len(scenes) == 6 * (384 + 4 + 4)
    assert {split for split, *_ in set_sequences("jradar-sim")} == {
        *("train", "validation", "test")
    }
    tested = {
        tuple(p) for split, *p in set_sequences("jradar-sim-test") if split == "test"
    }
    others = {tuple(p) for split, *p in set_sequences("jradar-sim") if split != "test"}
    assert len(tested) == 6 * 192 and not tested & others
    tiny = {"train": (("corridor", 5),), "test": (("corridor", 6),)}
    monkeypatch.setitem(SETS, "tiny", tiny)
    path = simulate_set("tiny", tmp_path, frames=1)
    manifest = read_manifest(tmp_path)
    assert path.exists() and manifest["sequences"]["corridor_6"]["split"] == "test"
    assert check_set(tmp_path) == []
    changed = tmp_path / "corridor_6/lidar/timestamps.txt"
    before = changed.stat().st_mtime_ns
    simulate_set("tiny", tmp_path, frames=1)  # goes on where it stopped: makes nothing
    assert changed.stat().st_mtime_ns == before
    changed.write_text("0\n")
    assert check_set(tmp_path) == ["corridor_6"]
    with pytest.raises(ValueError, match="another folder"):
        simulate_set("tiny", tmp_path, frames=2)


def options(**changes):
    given = dict(scene="corridor", set=None, frames=1, seed=5, output="x", json=True)
    given |= dict(sensor="single_chip", format="coloradar", dry_run=False)
    return SimpleNamespace(**(given | changes))


def test_the_command_writes_or_only_says_what_it_would(tmp_path):
    dry = simulate(options(output=tmp_path / "dry", dry_run=True))
    assert not (tmp_path / "dry").exists() and dry["size"] == "2 MB"
    done = simulate(options(output=tmp_path / "out"))
    assert done["written"] == str(tmp_path / "out" / "corridor_5")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": None}, "either --scene"),
        ({"set": "jradar-sim"}, "either --scene"),
        ({"format": "capture", "sensor": "both"}, "--format capture"),
        ({"scene": None, "set": "nothing"}, "jradar-sim"),
        ({"scene": "moon"}, "hallways"),
    ],
)
def test_wrong_options_are_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        simulate(options(output=tmp_path / "out", **changes))
    assert not (tmp_path / "out").exists()
