"""ColoRadar sequences written number by number come back; every variant and fault.

The writer shares nothing with the reader: `struct.pack` and loops in the files' order.
"""

import json
import math
import os
import struct
import warnings

import numpy as np
import pytest

from jradar.data import (
    SEQUENCES,
    calibrated_cube,
    coloradar_clouds,
    coloradar_heatmaps,
    coloradar_imu,
    coloradar_lidar,
    coloradar_poses,
    nearest_scan,
    open_coloradar,
    open_recording,
    paper_split,
    radar_from_lidar,
    scene,
)

START = 1608568420.25  # seconds since 1970
TX, RX, CHIRPS, SAMPLES = 2, 2, 4, 8
FRAME_BYTES = TX * RX * CHIRPS * SAMPLES * 4
WAVEFORM = f"""\
num_rx {RX}
num_tx {TX}
num_adc_samples_per_chirp {SAMPLES}
num_chirps_per_frame {CHIRPS}
adc_sample_frequency 10666000.0
start_frequency 76999999488.0
idle_time 0.00011
adc_start_time 7.00000009601e-06
ramp_end_time 1.99999994948e-05
frequency_slope 1.00000000377e+14
"""
ANTENNAS = "F_design 76.8\nrx 0 0 0\nrx 1 1 0\ntx 0 0 0\ntx 1 2 1\n"
RADAR_YAW = "0 0 0.706825181105 0.707388269167"
TRANSFORMS = {
    "single_chip": f"-0.145 0.09 -0.025\n{RADAR_YAW}\n",
    "cascade": f"0.03 0.12 -0.09\n{RADAR_YAW}\n",
    "lidar": "-0.075 -0.02 0.03618\n0.0 0.0 0.721382357437 -0.692536998563\n",
}


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())


def write_calib(folder, sensors=("single_chip",), transforms=TRANSFORMS):
    for sensor in sensors:
        write(folder / sensor / "waveform_cfg.txt", WAVEFORM)
        write(folder / sensor / "antenna_cfg.txt", ANTENNAS)
    for name, text in transforms.items():
        write(folder / "transforms" / f"base_to_{name}.txt", text)


def value(frame, tx, rx, chirp, sample):
    """In-phase part of one sample; its quadrature part is 1 - 2 of it."""
    return (frame * 1000 + tx * 317 + rx * 91 + chirp * 17 + sample * 5) % 4001 - 2000


def frame_bytes(frame):
    content = b""
    for tx in range(TX):
        for rx in range(RX):
            for chirp in range(CHIRPS):
                for sample in range(SAMPLES):
                    counts = value(frame, tx, rx, chirp, sample)
                    content += struct.pack("<hh", counts, 1 - 2 * counts)
    return content


def stamps_text(count, rate, start=START):
    return "".join(f"{start + n / rate:6f}\n" for n in range(count))


def write_radar(folder, sensor="single_chip", count=12, first=0):
    at = folder / sensor / "adc_samples"
    write(at / "timestamps.txt", stamps_text(count, 10))
    for n in range(count):
        write(at / "data" / f"frame_{n + first}.bin", frame_bytes(n))


def write_lidar(folder, count=12, points=((-3.0, 0.0, 0.0, 7.0), (0, 0, 0, 0))):
    write(folder / "lidar" / "timestamps.txt", stamps_text(count, 10, START + 0.01))
    content = b"".join(struct.pack("<4f", *point) for point in points)
    for n in range(count):
        name = f"lidar_pointcloud_{n}.bin"
        write(folder / "lidar" / "pointclouds" / name, content)


def write_poses(folder, source="groundtruth", count=14):
    """A base that drives 0.1 m along x and turns 0.1 rad a step."""
    rows = "".join(
        f"{0.1 * n} 0 0.5 0 0 {math.sin(0.05 * n)} {math.cos(0.05 * n)}\n"
        for n in range(count)
    )
    write(folder / source / "timestamps.txt", stamps_text(count, 10))
    write(folder / source / f"{source}_poses.txt", rows)


@pytest.fixture
def root(tmp_path):
    """A data set of one sequence, `ec_hallways_run0`, with all that the release has."""
    folder = tmp_path / "12_21_2020_ec_hallways_run0"
    write_calib(tmp_path / "calib")
    write_radar(folder)
    write_lidar(folder)
    write_poses(folder)
    return tmp_path


@pytest.fixture
def sequence(root):
    return root / "12_21_2020_ec_hallways_run0"


def expected_cube(frame):
    cube = np.zeros((TX, RX, CHIRPS, SAMPLES), complex)
    for at in np.ndindex(*cube.shape):
        counts = value(frame, *at)
        cube[at] = counts + 1j * (1 - 2 * counts)
    return cube


def test_every_sample_lies_where_it_was_written(sequence):
    recording = open_coloradar(sequence)
    assert recording.name == "12_21_2020_ec_hallways_run0"
    assert recording.radar.cube_shape == (TX, RX, CHIRPS, SAMPLES)
    assert len(recording.cubes) == 12
    for frame in (0, 1, 2, 10, 11):  # 10 comes after 9, not after 1
        assert recording.cubes[frame].dtype == np.complex64
        np.testing.assert_array_equal(recording.cubes[frame], expected_cube(frame))
    np.testing.assert_allclose(
        recording.cubes.stamps, START + np.arange(12) / 10, rtol=0, atol=1e-6
    )


def test_lidar_and_poses_come_along(sequence):
    recording = open_coloradar(sequence)
    assert recording.lidar is not None and recording.poses is not None
    scan = recording.lidar[3]
    np.testing.assert_array_equal(scan, np.array([[-3, 0, 0, 7], [0, 0, 0, 0]], "f4"))
    assert recording.lidar.stamps is not None
    assert recording.lidar.stamps[0] == pytest.approx(START + 0.01, abs=1e-6)
    np.testing.assert_allclose(recording.poses.xyz[4], [0.4, 0, 0.5])
    np.testing.assert_allclose(
        recording.poses.quaternion[4], [0, 0, math.sin(0.2), math.cos(0.2)]
    )
    np.testing.assert_array_equal(coloradar_lidar(sequence)[0], scan)
    np.testing.assert_array_equal(coloradar_poses(sequence).xyz, recording.poses.xyz)


def test_the_published_point_lands_where_it_must(sequence):
    recording = open_coloradar(sequence)
    seen = nearest_scan(recording, 5)
    np.testing.assert_allclose(seen, [[2.888, -0.190, 0.061]], atol=5e-4)
    matrix = radar_from_lidar(recording)
    assert matrix is not None
    yaw = math.degrees(math.atan2(matrix[1, 0], matrix[0, 0]))
    assert yaw == pytest.approx(177.708, abs=1e-3)
    np.testing.assert_allclose(matrix[:3, 3], [-0.10994, -0.07009, 0.06118], atol=1e-5)


def test_the_published_point_with_the_data_sets_own_values(root, sequence, samples):
    calib = samples / "coloradar_calib_reconstructed"
    write_radar(sequence, "cascade", count=1)
    recording = open_coloradar(sequence, sensor="single_chip", calib=calib)
    assert recording.radar.cube_shape == (3, 4, 128, 128)
    assert recording.coupling is not None and recording.coupling.shape == (3, 4, 64)
    matrix = radar_from_lidar(recording)
    assert matrix is not None
    np.testing.assert_allclose(
        matrix @ [-3, 0, 0, 1], [2.888, -0.190, 0.061, 1], atol=5e-4
    )
    cascade = radar_from_lidar(open_coloradar(sequence, sensor="cascade", calib=calib))
    assert cascade is not None
    np.testing.assert_allclose(cascade[:3, 3], [-0.14008, 0.10489, 0.12618], atol=1e-5)


def test_opening_reads_no_frame(sequence):
    for path in [*sequence.rglob("*.bin")]:
        path.write_bytes(b"x" * 3)
    recording = open_coloradar(sequence)
    assert len(recording.cubes) == 12 and recording.lidar is not None
    with pytest.raises(ValueError, match="frame_4.bin holds 3 bytes"):
        _ = recording.cubes[4]
    with pytest.raises(ValueError, match="lidar_pointcloud_4.bin holds 3 bytes"):
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


def test_calib_beside_the_target_of_a_link(root, sequence, tmp_path_factory):
    link = tmp_path_factory.mktemp("links") / "run"
    link.symlink_to(sequence)
    assert len(open_coloradar(link).cubes) == 12


def test_missing_calib_says_where_it_was_looked_for(tmp_path):
    write_radar(tmp_path / "run", count=1)
    with pytest.raises(
        ValueError, match=r"no calib/single_chip/waveform_cfg.txt .*run"
    ):
        open_coloradar(tmp_path / "run")


def test_the_radar_is_chosen(root, sequence):
    write_calib(root / "calib", ["cascade"])
    write_radar(sequence, "cascade", count=3)
    both = open_coloradar(sequence)
    assert both.radar.name == "coloradar single_chip" and len(both.cubes) == 12
    assert "radar: single_chip; cascade was recorded as well" in both.notes
    cascade = open_coloradar(sequence, sensor="cascade", tx_firing_order=(1, 0))
    assert cascade.radar.name == "coloradar cascade" and len(cascade.cubes) == 3
    assert cascade.radar.tx_firing_order == (1, 0)
    assert cascade.base_from_radar is not None
    np.testing.assert_allclose(cascade.base_from_radar[:3, 3], [0.03, 0.12, -0.09])
    with pytest.raises(ValueError, match="sensor='radar', expected one of"):
        open_coloradar(sequence, sensor="radar")


def test_a_radar_without_raw_samples(root, sequence):
    message = "has no cascade/adc_samples/data, it has those of single_chip"
    with pytest.raises(ValueError, match=message):
        open_coloradar(sequence, sensor="cascade")
    (root / "run" / "cascade" / "heatmaps").mkdir(parents=True)
    with pytest.raises(ValueError, match="no <radar>/adc_samples/data: .* a download"):
        open_recording(root / "run")


def test_only_a_radar(tmp_path):
    write_radar(tmp_path / "run", count=2)
    write_calib(tmp_path / "calib", transforms={})
    recording = open_coloradar(tmp_path / "run")
    assert recording.lidar is None and recording.poses is None
    assert recording.base_from_radar is None and radar_from_lidar(recording) is None
    assert nearest_scan(recording, 0) is None
    assert any("base_to_single_chip.txt" in note for note in recording.notes)


def test_a_sequence_that_was_unpacked_in_part(root):
    folder = root / "12_21_2020_ec_hallways_run1"
    write_radar(folder, count=2)
    write(folder / "lidar/timestamps.txt", stamps_text(2, 10))
    write(folder / "groundtruth/timestamps.txt", stamps_text(2, 10))
    recording = open_coloradar(folder)
    assert recording.lidar is None and recording.poses is None


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
    message = r"is no recording itself, name one that it holds: .*ec_hallways_run0"
    with pytest.raises(ValueError, match=message):
        open_recording(root)
    sequence.rename(root / "kitti")
    (root / "kitti" / "run").mkdir()
    with pytest.raises(ValueError, match="name one that it holds: .*kitti"):
        open_recording(root)


# Numbers and stamps


def test_a_gap_in_the_numbers_keeps_each_file_at_its_own_stamp(sequence):
    for missing in (4, 5, 9):
        (sequence / "single_chip/adc_samples/data" / f"frame_{missing}.bin").unlink()
    recording = open_coloradar(sequence)
    assert "3 of the numbers 0 to 11 are missing, first 4" in recording.notes[1]
    kept = [0, 1, 2, 3, 6, 7, 8, 10, 11]
    np.testing.assert_allclose(recording.cubes.stamps, START + np.array(kept) / 10)
    np.testing.assert_array_equal(recording.cubes[4], expected_cube(6))


def test_a_few_frames_of_a_sequence_with_all_stamps(sequence):
    for missing in (0, 1, 2, 3, 4, 10, 11):
        (sequence / "single_chip/adc_samples/data" / f"frame_{missing}.bin").unlink()
    recording = open_coloradar(sequence)
    notes = "\n".join(recording.notes)
    assert "first number is 5, taken as line 6" in notes
    assert "the last 2 of 12 stamps have no file" in notes
    np.testing.assert_allclose(recording.cubes.stamps, START + np.arange(5, 10) / 10)


def test_stamps_cut_with_the_frames_belong_to_the_first_number(sequence):
    data = sequence / "single_chip/adc_samples"
    for missing in range(7):
        (data / "data" / f"frame_{missing}.bin").unlink()
    write(data / "timestamps.txt", stamps_text(5, 10))
    recording = open_coloradar(sequence)
    assert "first number is 7, taken as line 1" in "\n".join(recording.notes)
    np.testing.assert_allclose(recording.cubes.stamps, START + np.arange(5) / 10)


@pytest.mark.parametrize(
    ("count", "items", "note"),
    [
        (10, 10, "10 stamps for 12 files: 2 files without a stamp are left out"),
        (15, 12, "the last 3 of 15 stamps have no file"),
    ],
)
def test_other_numbers_of_stamps_than_files(sequence, count, items, note):
    at = sequence / "single_chip/adc_samples/timestamps.txt"
    write(at, stamps_text(count, 10))
    recording = open_coloradar(sequence)
    assert len(recording.cubes) == items
    assert any(note in said for said in recording.notes)


def test_frames_without_stamps(sequence):
    (sequence / "single_chip/adc_samples/timestamps.txt").unlink()
    recording = open_coloradar(sequence)
    assert recording.cubes.stamps is None and len(recording.cubes) == 12
    assert "times are not known" in recording.notes[1]
    assert nearest_scan(recording, 0) is None


def test_integer_nanoseconds_and_blank_lines(sequence):
    lines = "\r\n\r\n".join(str(int(START * 1e9) + n * 10**8) for n in range(12))
    write(sequence / "single_chip/adc_samples/timestamps.txt", "\ufeff" + lines)
    stamps = open_coloradar(sequence).cubes.stamps
    np.testing.assert_allclose(stamps, START + np.arange(12) / 10, rtol=0, atol=1e-6)


def test_stamps_that_do_not_rise_are_said(sequence):
    times = START + np.array([0, 1, 2, 2, 4, 3, 6, 7, 8, 9, 10, 11]) / 10
    text = "\n".join(f"{time:6f}" for time in times)
    write(sequence / "single_chip/adc_samples/timestamps.txt", text)
    notes = "\n".join(open_coloradar(sequence).notes)
    assert "adc_samples/timestamps.txt: 1 of 12 stamps go back" in notes
    assert "1 of 12 stamps repeat the one before" in notes


def test_foreign_files_and_two_of_one_number(sequence):
    data = sequence / "single_chip/adc_samples/data"
    for name in ("._frame_1.bin", "frame_1.bin.part", "frame_x.bin", ".DS_Store"):
        write(data / name, b"?")
    assert len(open_coloradar(sequence).cubes) == 12
    write(data / "frame_03.bin", b"?")
    with pytest.raises(ValueError, match="frame_03.bin and frame_3.bin, expected one"):
        open_coloradar(sequence)


def test_a_folder_without_frames(sequence):
    data = sequence / "single_chip/adc_samples/data"
    for path in data.iterdir():
        path.rename(path.with_suffix(".dat"))
    with pytest.raises(ValueError, match=r"no frame_<N>.bin in .*12 other files"):
        open_coloradar(sequence)


# Records


@pytest.mark.parametrize("size", [0, 1, 2, 3, 4, FRAME_BYTES - 1, FRAME_BYTES + 4])
def test_frames_of_another_size_are_refused(sequence, size):
    path = sequence / "single_chip/adc_samples/data/frame_2.bin"
    path.write_bytes((frame_bytes(2) + b"1234")[:size])
    recording = open_coloradar(sequence)
    needed = (
        rf"frame_2.bin holds {size:,} bytes, 2 tx x 2 rx x 4 chirps x 8 samples x 2 "
        rf"halves of <i2 need {FRAME_BYTES}"
    )
    with pytest.raises(ValueError, match=needed):
        _ = recording.cubes[2]
    np.testing.assert_array_equal(recording.cubes[3], expected_cube(3))


@pytest.mark.parametrize("size", range(33))
def test_lidar_of_any_length(sequence, size):
    path = sequence / "lidar/pointclouds/lidar_pointcloud_0.bin"
    path.write_bytes(path.read_bytes()[:size])
    lidar = coloradar_lidar(sequence)
    if size % 16 == 0:  # whole points, or none
        assert lidar[0].shape == (size // 16, 4)
    else:
        with pytest.raises(ValueError, match=f"holds {size} bytes, .* multiple of 16"):
            _ = lidar[0]


def test_an_empty_scan_is_no_points(sequence):
    for path in (sequence / "lidar/pointclouds").iterdir():
        path.write_bytes(b"")
    seen = nearest_scan(open_coloradar(sequence), 0)
    assert seen is not None and seen.shape == (0, 3)


def test_the_nearest_scan_in_time(sequence):
    write(sequence / "lidar/timestamps.txt", stamps_text(12, 10, START + 0.3))
    for n in range(12):
        path = sequence / "lidar/pointclouds" / f"lidar_pointcloud_{n}.bin"
        path.write_bytes(struct.pack("<4f", 1.0 + n, 0, 0, 0))
    recording = open_coloradar(sequence)
    seen = nearest_scan(recording, 5)
    assert seen is not None
    assert np.linalg.norm(seen) == pytest.approx(3, abs=0.2)  # frame 5 is scan 2
    assert nearest_scan(recording, 0) is None
    assert nearest_scan(recording, 0, tolerance_s=0.31) is not None


def test_radar_clouds_and_heatmaps(sequence):
    at = sequence / "single_chip/pointclouds"
    write(at / "timestamps.txt", stamps_text(2, 10))
    write(at / "data/radar_pointcloud_0.bin", struct.pack("<5f", 1, 2, 3, 400, -0.5))
    write(at / "data/radar_pointcloud_1.bin", b"")
    clouds = coloradar_clouds(sequence)
    np.testing.assert_array_equal(clouds[0], np.array([[1, 2, 3, 400, -0.5]], "f4"))
    assert clouds[1].shape == (0, 5)

    at = sequence / "single_chip/heatmaps"
    write(at / "timestamps.txt", stamps_text(1, 10))
    write(at / "data/heatmap_0.bin", struct.pack("<24f", *range(24)))
    write(
        sequence / "calib/single_chip/heatmap_cfg.txt",
        "num_range_bins 3\nnum_elevation_bins 2\nnum_azimuth_bins 2\n"
        "range_bin_width 0.125\nazimuth_bins -0.5 0.5\n",
    )
    heatmaps = coloradar_heatmaps(
        sequence, sensor="single_chip", calib=sequence / "calib"
    )
    assert heatmaps[0].shape == (2, 2, 3, 2)
    assert heatmaps[0][1, 0, 2, 1] == 1 * 12 + 0 * 6 + 2 * 2 + 1
    released = coloradar_heatmaps(sequence, sensor="single_chip")
    with pytest.raises(ValueError, match="holds 96 bytes, .* need 524,288: truncated"):
        _ = released[0]


def test_imu_and_vicon(sequence):
    write(sequence / "imu/timestamps.txt", stamps_text(3, 300))
    write(sequence / "imu/imu_data.txt", "0 1 9.8 .1 .2 .3\n" * 2)
    with pytest.warns(UserWarning, match="3 stamps for 2 lines of imu_data.txt"):
        imu = coloradar_imu(sequence)
    np.testing.assert_array_equal(imu.acceleration, [[0, 1, 9.8]] * 2)
    np.testing.assert_array_equal(imu.angular_velocity, [[0.1, 0.2, 0.3]] * 2)
    assert len(imu.stamps) == 2
    write_poses(sequence, "vicon", count=4)
    assert len(coloradar_poses(sequence, source="vicon").stamps) == 4
    with pytest.raises(ValueError, match="source='gps'"):
        coloradar_poses(sequence, source="gps")


def test_poses_come_at_rising_times(sequence):
    times = START + np.array([0, 2, 1, 1, 3])
    write(sequence / "groundtruth/timestamps.txt", "\n".join(map(repr, times.tolist())))
    rows = "".join(f"{n} 0 0 0 0 0 1\n" for n in range(5))
    write(sequence / "groundtruth/groundtruth_poses.txt", rows)
    with pytest.warns(UserWarning, match="1 of 5 stamps"):
        poses = coloradar_poses(sequence)
    np.testing.assert_array_equal(poses.stamps - START, [0, 1, 2, 3])
    np.testing.assert_array_equal(poses.xyz[:, 0], [0, 2, 1, 4])


# Text files


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty, expected 1 numbers a line"),
        (b"\n \n", "is empty"),
        (b"# only a comment\n", "expected 1 numbers"),
        (b"\x80\xff\x00\x01" * 9, "is not a text file|expected 1 numbers"),
        (b"1608568420.25\nNaN\n", "1 lines hold NaN .* number 2"),
        (b"1608568420.25\ninf\n", "1 lines hold NaN or infinite"),
        (b"1608568420.25 1\n", "has 2 numbers a line, expected 1"),
        (b"1608568420.25\n1 2\n", "expected 1 numbers a line"),
        (b"1608568420,25\n", "expected 1 numbers a line"),
        (b"yesterday\n", "expected 1 numbers a line"),
    ],
)
def test_unusable_stamps_are_refused(sequence, content, message):
    write(sequence / "single_chip/adc_samples/timestamps.txt", content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=rf"timestamps.txt.*({message})"):
            open_coloradar(sequence)


def test_a_billion_stamps_are_refused_before_they_are_read(sequence):
    with (sequence / "lidar/timestamps.txt").open("wb") as file:
        file.truncate(18 * 10**9)  # takes no room on the disk
    with pytest.raises(ValueError, match="18,000,000,000 bytes, at most 67,108,864"):
        open_coloradar(sequence)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "-145 90 -25\n0 0 0.7071068 0.7071068\n",
            "172.* m from the base.*millimetres",
        ),
        ("0 0 0\n0 0 0 0.5\n", "length 0.5, expected 1"),
        ("0 0 0\n0 0 0 0\n", "length 0, expected 1"),
        ("0 0 0\n0 0 1\n", "holds 6 numbers, expected 7"),
        ("0 0 nan\n0 0 0 1\n", "expected 7 finite"),
        ("0 0 zero\n0 0 0 1\n", "expected numbers"),
        (b"\xff\xfe\x80", "expected numbers"),
        ("0 " * 9999, "is no transform"),
    ],
)
def test_unusable_transforms_are_refused(root, sequence, text, message):
    write(root / "calib/transforms/base_to_lidar.txt", text)
    with pytest.raises(ValueError, match=rf"base_to_lidar.txt.*{message}"):
        open_coloradar(sequence)


def test_poses_that_are_no_rotations_are_refused(sequence):
    rows = "0 0 0 0 0 0 1\n" * 3 + "0 0 0 1 1 1 1\n" + "0 0 0 0 0 0 1\n" * 10
    write(sequence / "groundtruth/groundtruth_poses.txt", rows)
    with pytest.raises(ValueError, match="line 4 of .* length 2, expected 1"):
        open_coloradar(sequence)


def test_links_that_lead_in_circles_end_in_an_error(root, sequence):
    loop = sequence / "single_chip/adc_samples/data/frame_0.bin"
    loop.unlink()
    loop.symlink_to(loop)
    recording = open_coloradar(sequence)
    with pytest.raises(OSError, match="frame_0.bin"):
        _ = recording.cubes[0]
    circle = root / "circle"
    os.symlink(circle, circle)
    with pytest.raises(FileNotFoundError, match="circle"):
        open_recording(circle)
    (sequence / "calib").symlink_to(sequence / "calib")  # the one beside is taken
    assert len(open_coloradar(sequence).cubes) == 12


# Calibration


def test_coupling_and_frequency_phase_are_read_and_applied(root, sequence):
    bins = SAMPLES // 2
    halves = ", ".join(str(n) for n in range(2 * TX * RX * bins))
    write(
        root / "calib/single_chip/coupling_calib.txt",
        f"num_tx:{TX}\nnum_rx:{RX}\nnum_range_bins:{bins}\nnum_doppler_bins:1\n"
        f"data:{halves}\n",
    )
    measured = {
        "numTx": TX,
        "numRx": RX,
        "frequencySlope": 50e12,
        "samplingRate": 5.333e6,
        "frequencyCalibrationMatrix": [10.0, 10.5, 11.0, 9.0],
        "phaseCalibrationMatrix": [1, 0, 0, 2, -1, 0, 0.6, 0.8],
    }
    path = root / "calib/single_chip/phase_frequency_calib.txt"
    write(path, json.dumps({"antennaCalib": measured}))
    recording = open_coloradar(sequence)
    assert recording.coupling is not None
    assert recording.coupling[1, 0, 2] == 2 * 10 + 1j * (2 * 10 + 1)
    shift, phase = [0, 0.5, 1, -1], [1, 2j, -1, 0.6 + 0.8j]
    scale = 1.00000000377e14 / 50e12 * 5.333e6 / 10666000.0
    expected = expected_cube(1).reshape(TX * RX, CHIRPS, SAMPLES)
    for pair in range(TX * RX):
        for n in range(SAMPLES):
            turn = np.exp(-2j * math.pi * shift[pair] * scale * n / SAMPLES)
            expected[pair, :, n] *= turn / phase[pair]
    cube = np.asarray(calibrated_cube(recording, 1)).reshape(expected.shape)
    np.testing.assert_allclose(cube, expected, rtol=2e-5, atol=1e-2)


def test_factors_of_channels_are_applied(sequence):
    factors = np.array([1, 1j, -1, 0.5], np.complex64)
    recording = open_coloradar(sequence)._replace(channel_factors=factors)
    cube = np.asarray(calibrated_cube(recording, 0))
    expected = expected_cube(0) * factors.reshape(TX, RX, 1, 1)
    np.testing.assert_allclose(cube, expected, rtol=1e-6)


def test_calibration_of_another_array_is_refused(root, sequence):
    path = root / "calib/single_chip/coupling_calib.txt"
    write(path, "num_tx:1\nnum_rx:1\nnum_range_bins:1\nnum_doppler_bins:1\ndata:1,2\n")
    message = r"coupling_calib.txt is for an array of \(1, 1, 1\).* needs \(2, 2, 4\)"
    with pytest.raises(ValueError, match=message):
        open_coloradar(sequence)


# The paper's split


def test_there_are_52_sequences_and_21_train():
    names = [name for names in SEQUENCES.values() for name in names]
    assert len(names) == len(set(names)) == 52
    counts = {place: len(names) for place, names in SEQUENCES.items()}
    assert counts == {
        "arpg_lab": 5,
        "ec_hallways": 5,
        "aspen": 12,
        "longboard": 8,
        "outdoors": 10,
        "edgar_army": 6,
        "edgar_classroom": 6,
    }
    assert SEQUENCES["aspen"][-2:] == ("2_24_2021_aspen_run10", "2_24_2021_aspen_run11")
    assert [paper_split(name) for name in names].count("train") == 21


@pytest.mark.parametrize(
    ("name", "split", "where"),
    [
        ("12_21_2020_ec_hallways_run2", "train", "Hallways"),
        ("ec_hallways_run3", "test", "Hallways"),
        ("aspen_run10", "test", "Aspen Lab"),
        ("aspen_run1", "train", "Aspen Lab"),
        ("edgar_army_run0", "train", "Edgar Mine"),
        ("2_23_2021_edgar_classroom_run5", "test", "Edgar Mine"),
        ("2_28_2021_outdoors_run9", "test", "Outdoor"),
        ("arpg_lab_run4", "test", "Arpg Lab"),
        ("longboard_run7", "test", "Longboard"),
    ],
)
def test_split_and_scene_of_a_name(name, split, where):
    assert (paper_split(name), scene(name)) == (split, where)


@pytest.mark.parametrize(
    "name", ["ec_hallways_run5", "1_1_2020_aspen_run0", "run0", "", "aspen_run01"]
)
def test_names_of_no_sequence_are_refused(name):
    with pytest.raises(
        ValueError, match="is no sequence of ColoRadar, expected a name"
    ):
        paper_split(name)
