"""Sequences on disk: layout, sizes, calibration, same bytes again, never half."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.lidar import rigid_transform, transform
from jradar.radar import RadarSpec, range_doppler, subtract_leakage
from jradar.recordings import read_coupling
from jradar.recordings.coloradar.calib import radar_from_coloradar, read_frequency_phase
from jradar.simulation import sequence, simulate_sequence
from jradar.simulation.coloradar_writer import write_calib
from jradar.simulation.hardware.hardware import channel_factors, make_hardware
from jradar.simulation.sets import folder_digest
from tests.simulation.worlds import straight

RADAR = RadarSpec.awr1843()


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
    assert stamps[0] < sequence.EPOCH_S + 0.06 and stamps[-1] > sequence.EPOCH_S + 0.25
    imu = np.loadtxt(folder / "imu" / "imu_data.txt")
    assert imu.shape == (len(np.loadtxt(folder / "imu" / "timestamps.txt")), 6)


def test_the_calib_folder_describes_what_was_simulated(folder):
    calib = folder.parent / "calib"
    for name, radar in (("single_chip", RADAR), ("cascade", RadarSpec.cascade())):
        read = radar_from_coloradar(calib / name)
        for field in ("tx_positions", "rx_positions", "tx_firing_order", "cube_shape"):
            assert getattr(read, field) == getattr(radar, field)
        for field in ("start_frequency_hz", "slope_hz_per_s", "chirp_period_s"):
            expected = pytest.approx(getattr(radar, field), rel=1e-9)
            assert getattr(read, field) == expected
        shape = (*radar.cube_shape[:2], radar.num_samples // 2)
        assert read_coupling(calib / name / "coupling_calib.txt").shape == shape
    hardware = make_hardware("cascade", RadarSpec.cascade())
    file = calib / "cascade" / "phase_frequency_calib.txt"
    channels, bins = read_frequency_phase(file, RadarSpec.cascade())
    shift, phase = hardware.frequency, hardware.phase
    np.testing.assert_allclose(bins, shift - shift[0, 0], atol=1e-5)
    np.testing.assert_allclose(channels, phase[0, 0] / phase, rtol=1e-5)
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
    cube = jnp.asarray(cube, jnp.complex64)
    spectrum, power = range_doppler(cube, range_window="blackman")
    left = subtract_leakage(spectrum, jnp.asarray(coupling, jnp.complex64))
    left = (np.abs(left[..., 1:65]) ** 2).sum(0)
    assert left.max() < 1e-6 * np.asarray(power)[:, 1:65].max()


def test_a_real_calib_folder_is_not_replaced(tmp_path):
    (tmp_path / "calib" / "transforms").mkdir(parents=True)
    with pytest.raises(UsageError, match="calib holds transforms but no simulated.txt"):
        write_calib(tmp_path / "calib", {})


def test_the_same_seed_gives_the_same_bytes_in_another_process(folder, tmp_path):
    code = (
        "from jradar.simulation import simulate_sequence as s; "
        f"s('corridor', 5, {str(tmp_path)!r}, frames=2)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    assert folder_digest(tmp_path / "corridor_5") == folder_digest(folder)
    assert folder_digest(tmp_path / "calib") == folder_digest(folder.parent / "calib")


def test_an_interrupted_run_leaves_nothing_half_written(scene_built_once, tmp_path):
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate_sequence("corridor", 5, tmp_path, frames=2, advance=interrupt)
    assert [p.name for p in tmp_path.iterdir()] == ["calib"]


def test_size_of_a_frame(folder):
    files = [*folder.rglob("frame_0.bin"), *folder.rglob("lidar_pointcloud_0.bin")]
    assert sequence.frame_bytes() == sum(path.stat().st_size for path in files)
    cascade = 4 * 12 * 16 * 16 * 256  # half as many frames as the single chip
    assert sequence.frame_bytes(sensor="both") - sequence.frame_bytes() == cascade / 2


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("moon", 5), {}, "hallways"),
        (("corridor", 5), {"frames": 0}, "1 or more"),
        (("corridor", 5), {"sensor": "sonar"}, "cascade"),
    ],
)
def test_wrong_options_are_usage_errors(tmp_path, arguments, options, message):
    with pytest.raises(UsageError, match=message):
        simulate_sequence(*arguments, tmp_path / "out", **options)
    assert not (tmp_path / "out").exists()


def test_the_noise_of_the_imu_is_a_density_by_the_root_of_its_rate(corridor):
    """180 ug and 0.01 deg/s by the root of Hz; biases are constant and drawn once."""
    resting = corridor._replace(scene=corridor.scene._replace(platform=straight(0.0)))
    stamps = np.arange(1200) / sequence.CLOCKS["imu"].rate_hz
    settings = [resting._replace(seed=seed) for seed in range(40)]
    records = np.stack([sequence.imu_records(setting, stamps) for setting in settings])
    mean = records.mean((0, 1))  # a resting IMU feels gravity alone
    assert np.linalg.norm(mean[:3]) == pytest.approx(9.81, abs=0.1)
    assert np.abs(mean[3:]).max() < 0.01
    noise = records - records.mean(1, keepdims=True)
    density = noise.std((0, 1)) / np.sqrt(sequence.CLOCKS["imu"].rate_hz)
    np.testing.assert_allclose(density[:3] / 9.80665e-6, 180, rtol=0.05)
    np.testing.assert_allclose(np.degrees(density[3:]), 0.01, rtol=0.05)
    halves = noise.reshape(40, 2, 600, 6).mean(2)
    np.testing.assert_allclose(halves.std((0, 1)), noise.std((0, 1)) / 600**0.5, rtol=1)
    bias = records.mean(1) - np.median(records.mean(1), 0)
    spread = bias.std(0).reshape(2, 3).mean(1)
    np.testing.assert_allclose(spread, sequence.IMU_BIAS, rtol=0.3)
