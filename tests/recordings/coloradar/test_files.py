"""ColoRadar's files: numbers and stamps, records, text; every variant and fault."""

import os
import struct
import warnings

import numpy as np
import pytest

from jradar.recordings import nearest_scan, open_recording
from jradar.recordings.coloradar.sequence import open_coloradar
from tests.recordings.coloradar_writer import (
    FRAME_BYTES,
    START,
    expected_cube,
    frame_bytes,
    stamps_text,
    write,
)

# Numbers and stamps


@pytest.mark.parametrize(
    ("missing", "stamps", "kept", "times", "notes"),
    [
        (
            (4, 5, 9),
            *(12, [0, 1, 2, 3, 6, 7, 8, 10, 11], [0, 1, 2, 3, 6, 7, 8, 10, 11]),
            ["3 of the numbers 0 to 11 are missing, first 4"],
        ),
        (
            (0, 1, 2, 3, 4, 10, 11),
            *(12, range(5, 10), range(5, 10)),
            ["number is 5, taken as line 6", "the last 2 of 12 stamps have no file"],
        ),
        (range(7), 5, range(7, 12), range(5), ["number is 7, taken as line 1"]),
        ((), 10, range(10), range(10), ["10 stamps for 12 files: 2 files without"]),
        ((), 15, range(12), range(12), ["the last 3 of 15 stamps have no file"]),
    ],
)
def test_each_file_has_its_own_stamp(sequence, missing, stamps, kept, times, notes):
    at = sequence / "single_chip/adc_samples"
    for number in missing:
        (at / "data" / f"frame_{number}.bin").unlink()
    write(at / "timestamps.txt", stamps_text(stamps, 10))
    recording = open_coloradar(sequence)
    np.testing.assert_allclose(recording.cubes.stamps, START + np.array(times) / 10)
    for cube, number in zip(recording.cubes, kept, strict=True):
        np.testing.assert_array_equal(cube, expected_cube(number))
    found = "\n".join(recording.notes)
    assert all(note in found for note in notes)
    assert found.count("\n") == len(notes)  # the first one names the calibration


def test_frames_without_stamps(sequence):
    (sequence / "single_chip/adc_samples/timestamps.txt").unlink()
    recording = open_coloradar(sequence)
    assert recording.cubes.stamps is None and len(recording.cubes) == 12
    assert "times are unknown" in recording.notes[1]
    assert nearest_scan(recording, 0) is None


def test_stamps_may_be_integer_nanoseconds_and_are_reported_if_they_fall(sequence):
    path = sequence / "single_chip/adc_samples/timestamps.txt"
    lines = "\r\n\r\n".join(str(int(START * 1e9) + n * 10**8) for n in range(12))
    write(path, "\ufeff" + lines)
    stamps = open_coloradar(sequence).cubes.stamps
    np.testing.assert_allclose(stamps, START + np.arange(12) / 10, rtol=0, atol=1e-6)
    times = START + np.array([0, 1, 2, 2, 4, 3, 6, 7, 8, 9, 10, 11]) / 10
    write(path, "\n".join(f"{time:6f}" for time in times))
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
    for path in data.iterdir():
        path.rename(path.with_suffix(".dat"))
    with pytest.raises(ValueError, match=r"no frame_<N>.bin in .*17 other files"):
        open_coloradar(sequence)


# Records


def test_frames_of_another_size_are_refused(sequence):
    path = sequence / "single_chip/adc_samples/data/frame_2.bin"
    recording = open_coloradar(sequence)
    for size in (0, 3, FRAME_BYTES - 1, FRAME_BYTES + 4):
        path.write_bytes((frame_bytes(2) + b"1234")[:size])
        needed = (
            rf"frame_2.bin holds {size:,} bytes, 2 tx x 2 rx x 4 chirps x 8 samples x "
            rf"2 halves of <i2 need {FRAME_BYTES}"
        )
        with pytest.raises(ValueError, match=needed):
            _ = recording.cubes[2]
    np.testing.assert_array_equal(recording.cubes[3], expected_cube(3))


def test_lidar_of_any_length(sequence):
    path = sequence / "lidar/pointclouds/lidar_pointcloud_0.bin"
    lidar, whole = open_coloradar(sequence).lidar, path.read_bytes()
    for size in (0, 16, 32):
        path.write_bytes(whole[:size])
        assert lidar[0].shape == (size // 16, 4)
    for size in (1, 15, 31):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match=f"holds {size} bytes, .* multiple of 16"):
            _ = lidar[0]
    path.write_bytes(b"")
    assert nearest_scan(open_coloradar(sequence), 0).shape == (0, 3)


def test_the_nearest_scan_in_time(sequence):
    write(sequence / "lidar/timestamps.txt", stamps_text(12, 10, START + 0.3))
    for n in range(12):
        path = sequence / "lidar/pointclouds" / f"lidar_pointcloud_{n}.bin"
        path.write_bytes(struct.pack("<4f", 1.0 + n, 0, 0, 0))
    recording = open_coloradar(sequence)
    seen = np.linalg.norm(nearest_scan(recording, 5))
    assert seen == pytest.approx(3, abs=0.2)  # frame 5 is scan 2
    assert nearest_scan(recording, 0) is None
    assert nearest_scan(recording, 0, tolerance_s=0.31) is not None


def test_more_stamps_than_lines(sequence):
    write(sequence / "groundtruth/timestamps.txt", stamps_text(20, 10))
    write(sequence / "imu/timestamps.txt", stamps_text(3, 100))
    write(sequence / "imu/imu_data.txt", "1 2 9.8 4 5 6\n7 8 9 1 2 3\n")
    recording = open_coloradar(sequence)
    assert len(recording.poses.stamps) == 14
    notes = "\n".join(recording.notes)
    assert "20 stamps for 14 lines of groundtruth_poses.txt: only the first 14" in notes
    assert "imu: 3 stamps for 2 lines of imu_data.txt: only the first 2 are" in notes
    np.testing.assert_array_equal(recording.imu.force, [[1, 2, 9.8], [7, 8, 9]])
    np.testing.assert_array_equal(recording.imu.rate, [[4, 5, 6], [1, 2, 3]])
    np.testing.assert_allclose(recording.imu.stamps, [START, START + 0.01])


def test_poses_come_at_rising_times(sequence):
    times = START + np.array([0, 2, 1, 1, 3])
    write(sequence / "groundtruth/timestamps.txt", "\n".join(map(repr, times.tolist())))
    rows = "".join(f"{n} 0 0 0 0 0 1\n" for n in range(5))
    write(sequence / "groundtruth/groundtruth_poses.txt", rows)
    recording = open_coloradar(sequence)
    assert "1 of 5 stamps" in "\n".join(recording.notes)
    poses = recording.poses
    np.testing.assert_array_equal(poses.stamps - START, [0, 1, 2, 3])
    np.testing.assert_array_equal(poses.xyz[:, 0], [0, 2, 1, 4])


# Text files


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty, expected 1 numbers per line"),
        (b"# only a comment\n", "expected 1 numbers"),
        (b"\x80\xff\x00\x01" * 9, "is not a text file|expected 1 numbers"),
        (b"1608568420.25\nNaN\n", "1 lines contain NaN .* number 2"),
        (b"1608568420.25 1\n", "has 2 numbers per line, expected 1"),
        (b"1608568420,25\n", "expected 1 numbers per line"),
    ],
)
def test_unusable_stamps_are_refused(sequence, content, message):
    write(sequence / "single_chip/adc_samples/timestamps.txt", content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=rf"timestamps.txt.*({message})"):
            open_coloradar(sequence)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("-145 90 -25\n0 0 0.7071068 0.7071068\n", "172.* m from the base.*millimet"),
        ("0 0 0\n0 0 0 0.5\n", "length 0.5, expected 1"),
        ("0 0 0\n0 0 0 0\n", "length 0, expected 1"),
        ("0 0 0\n0 0 1\n", "not a transform.* 6 numbers, expected 7"),
        ("0 0 nan\n0 0 0 1\n", "expected 7 finite"),
        ("0 0 zero\n0 0 0 1\n", "not a transform.* could not convert"),
        (b"\xff\xfe\x80", "is not a text file"),
    ],
)
def test_unusable_transforms_are_refused(root, sequence, text, message):
    write(root / "calib/transforms/base_to_lidar.txt", text)
    with pytest.raises(ValueError, match=rf"base_to_lidar.txt.*{message}"):
        open_coloradar(sequence)


def test_poses_that_are_no_rotations_are_refused(sequence):
    path = sequence / "groundtruth/groundtruth_poses.txt"
    rows = path.read_text().splitlines()
    write(path, "\n".join([*rows[:3], "0 0 0 1 1 1 1", *rows[4:]]))
    with pytest.raises(ValueError, match=r"at .*420.550000 s has length 2, exp"):
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
