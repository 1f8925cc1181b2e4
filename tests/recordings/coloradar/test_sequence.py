"""ColoRadar sequences come back as they were written, wherever their parts lie."""

import math

import numpy as np
import pytest

from jradar.radar import Radar, calibrate
from jradar.recordings import nearest_scan, open_recording, write_radar_toml
from jradar.recordings.coloradar.sequence import open_coloradar
from jradar.recordings.recording import radar_from_lidar
from tests.recordings.coloradar_writer import (
    CHIRPS,
    RX,
    SAMPLES,
    START,
    TRANSFORMS,
    TX,
    coupling_text,
    expected_cube,
    phases_text,
    stamps_text,
    write,
    write_calib,
    write_radar,
)


def test_every_sample_lies_where_it_was_written(sequence):
    recording = open_coloradar(sequence)
    assert recording.name == "12_21_2020_ec_hallways_run0"
    assert recording.radar.spec.cube_shape == (TX, RX, CHIRPS, SAMPLES)
    assert len(recording.cubes) == 12
    for frame in (0, 1, 2, 10, 11):  # 10 comes after 9, not after 1
        assert recording.cubes[frame].dtype == np.complex64
        np.testing.assert_array_equal(recording.cubes[frame], expected_cube(frame))
    times = START + np.arange(12) / 10
    np.testing.assert_allclose(recording.cubes.stamps, times, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(recording.lidar[3], [[-3, 0, 0, 7], [0, 0, 0, 0]])
    assert recording.lidar[3].dtype == np.float32
    assert recording.lidar.stamps[0] == pytest.approx(START + 0.01, abs=1e-6)
    np.testing.assert_allclose(recording.poses.xyz[4], [0.4, 0, 0.5])
    turn = [0, 0, math.sin(0.2), math.cos(0.2)]
    np.testing.assert_allclose(recording.poses.quaternion[4], turn)


def test_the_published_point_lands_where_it_must(sequence):
    recording = open_coloradar(sequence)
    seen = nearest_scan(recording, 5)
    np.testing.assert_allclose(seen, [[2.888, -0.190, 0.061]], atol=5e-4)
    matrix = radar_from_lidar(recording)
    yaw = math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))
    assert yaw == pytest.approx(177.708, abs=1e-3)
    np.testing.assert_allclose(matrix[:3, 3], [-0.10994, -0.07009, 0.06118], atol=1e-5)


def test_the_published_point_with_the_data_sets_own_values(root, sequence, samples):
    calib = samples / "coloradar_calib_reconstructed"
    write_radar(sequence, "cascade", count=1)
    recording = open_coloradar(sequence, calib, sensor="single_chip")
    assert recording.radar.spec.cube_shape == (3, 4, 128, 128)
    assert np.shape(recording.radar.leakage) == (3, 4, 64)
    point = radar_from_lidar(recording) @ [-3, 0, 0, 1]
    np.testing.assert_allclose(point, [2.888, -0.190, 0.061, 1], atol=5e-4)
    cascade = radar_from_lidar(open_coloradar(sequence, calib, sensor="cascade"))
    np.testing.assert_allclose(cascade[:3, 3], [-0.14008, 0.10489, 0.12618], atol=1e-5)


def test_opening_reads_no_frame(sequence):
    for path in [*sequence.rglob("*.bin")]:
        path.write_bytes(b"x" * 3)
    recording = open_coloradar(sequence)
    assert len(recording.cubes) == 12
    with pytest.raises(ValueError, match="frame_4.bin holds 3 bytes"):
        _ = recording.cubes[4]
    with pytest.raises(ValueError, match="lidar_pointcloud_4.bin .* holds 3 bytes"):
        _ = recording.lidar[4]


# Where things lie


@pytest.mark.parametrize("calib", ["inside", "beside", "above", "kitti"])
def test_calib_is_found_where_users_unpack_it(tmp_path, calib, monkeypatch):
    folder, place = {
        "inside": ("ec_hallways_run0", "ec_hallways_run0/calib"),
        "beside": ("ec_hallways_run0", "calib"),
        "above": ("data/ec_hallways_run0", "calib"),
        "kitti": ("root/kitti/ec_hallways_run0", "root/calib"),
    }[calib]
    write_radar(tmp_path / folder, count=1)
    write_calib(tmp_path / place)
    recording = open_coloradar(tmp_path / folder)
    assert recording.base_from_radar is not None
    assert recording.notes == (f"calibration: {tmp_path / place}",)
    monkeypatch.chdir(tmp_path / folder)
    assert open_coloradar(".").name == "ec_hallways_run0"


def test_calib_beside_the_target_of_a_link_or_nowhere(root, sequence, tmp_path_factory):
    link = tmp_path_factory.mktemp("links") / "run"
    link.symlink_to(sequence)
    assert len(open_coloradar(link).cubes) == 12
    (root / "calib").rename(root / "other")
    with pytest.raises(ValueError, match="no calib/single_chip/waveform_cfg.txt .*run"):
        open_coloradar(link)


def test_the_radar_is_chosen(root, sequence):
    write_calib(root / "calib", ["cascade"])
    write_radar(sequence, "cascade", count=3)
    both = open_coloradar(sequence)
    assert both.radar.spec.name == "coloradar single_chip" and len(both.cubes) == 12
    assert "radar: single_chip; cascade was recorded as well" in both.notes
    cascade = open_coloradar(sequence, sensor="cascade")
    assert cascade.radar.spec.name == "coloradar cascade" and len(cascade.cubes) == 3
    np.testing.assert_allclose(cascade.base_from_radar[:3, 3], [0.03, 0.12, -0.09])
    with pytest.raises(ValueError, match="sensor = 'radar', expected single_chip or"):
        open_coloradar(sequence, sensor="radar")


def test_a_radar_without_raw_samples(root, sequence):
    message = "holds no cascade/adc_samples/data, but single_chip/adc_samples"
    with pytest.raises(ValueError, match=message):
        open_coloradar(sequence, sensor="cascade")
    (root / "run" / "cascade" / "heatmaps").mkdir(parents=True)
    with pytest.raises(ValueError, match="no <radar>/adc_samples/data: .* separate"):
        open_recording(root / "run")


def test_only_a_radar(tmp_path):
    write_radar(tmp_path / "run", count=2)
    for part in ("lidar", "groundtruth"):  # unpacked in part
        write(tmp_path / "run" / part / "timestamps.txt", stamps_text(2, 10))
    write_calib(tmp_path / "calib", transforms={})
    recording = open_coloradar(tmp_path / "run")
    assert recording.lidar is None and recording.poses is None
    assert recording.base_from_radar is None and radar_from_lidar(recording) is None
    assert nearest_scan(recording, 0) is None
    assert any("base_to_single_chip.txt" in note for note in recording.notes)


def test_coloradar_plus_numbers_from_1_and_has_one_radar(tmp_path):
    write_radar(tmp_path / "run", "cascade", count=3, first=1)
    transforms = {"radar": TRANSFORMS["cascade"], "lidar": TRANSFORMS["lidar"]}
    write_calib(tmp_path / "calib", ["cascade"], transforms)
    recording = open_coloradar(tmp_path / "run")
    assert recording.base_from_radar is not None and len(recording.notes) == 1
    for frame in range(3):
        np.testing.assert_array_equal(recording.cubes[frame], expected_cube(frame))
    np.testing.assert_allclose(recording.cubes.stamps, START + np.arange(3) / 10)


def test_open_recording_takes_a_sequence_and_names_those_in_a_folder(root, sequence):
    assert len(open_recording(sequence).cubes) == 12
    assert len(open_recording(sequence, root / "calib").cubes) == 12
    message = r"is not a recording; name one inside it: .*ec_hallways_run0"
    with pytest.raises(ValueError, match=message):
        open_recording(root)
    sequence.rename(root / "kitti")
    (root / "kitti" / "run").mkdir()
    with pytest.raises(ValueError, match="name one inside it: .*kitti"):
        open_recording(root)


# Calibration


COUPLING = np.arange(32.0).view(complex).reshape(TX, RX, SAMPLES // 2)


def write_coupling(root, values=COUPLING):
    write(root / "calib/single_chip/coupling_calib.txt", coupling_text(values))


def test_coupling_and_frequency_phase_are_read_and_applied(root, sequence):
    write_coupling(root)
    phase = np.array([1, 2j, -1, 0.6 + 0.8j])
    bins = np.array([[10.0, 10.5], [11.0, 9.0]])
    rates = {"frequencySlope": 50e12, "samplingRate": 5.333e6}
    text = phases_text(bins, phase, **rates)
    write(root / "calib/single_chip/phase_frequency_calib.txt", text)
    recording = open_coloradar(sequence)
    assert recording.radar.leakage is not None
    assert recording.radar.leakage[1, 0, 2] == 2 * 10 + 1j * (2 * 10 + 1)
    scale = 1.00000000377e14 / 50e12 * 5.333e6 / 10666000.0
    shift = scale * (bins - 10).reshape(TX, RX, 1, 1)
    turn = np.exp(-2j * math.pi * shift * np.arange(SAMPLES) / SAMPLES)
    expected = expected_cube(1) * turn / phase.reshape(TX, RX, 1, 1)
    cube = np.asarray(calibrate(recording.cube(1), recording.radar))
    np.testing.assert_allclose(cube, expected, rtol=2e-5, atol=1e-2)


def test_the_leakage_takes_the_factors_of_its_channels(root, sequence, tmp_path):
    write_coupling(root)
    plain, file = open_recording(sequence), tmp_path / "factors.toml"
    factors = (1 + 0j, 1j, -1 + 0j, 0.5 + 0.25j)
    write_radar_toml(file, Radar(plain.radar.spec).with_factors(factors))
    found = open_recording(sequence, file)
    expected = plain.radar.leakage * np.reshape(factors, (TX, RX, 1))
    np.testing.assert_allclose(found.radar.leakage, expected, rtol=1e-5)
    assert found.radar.leakage.dtype == plain.radar.leakage.dtype


def test_calibration_of_another_array_is_refused(root, sequence):
    write_coupling(root, np.array([[[1 + 2j]]]))
    message = r"coupling_calib.txt .* shape \(1, 1, 1\), .* needs \(2, 2, 4\)"
    with pytest.raises(ValueError, match=message):
        open_coloradar(sequence)
