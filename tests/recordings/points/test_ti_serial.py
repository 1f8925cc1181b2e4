"""TI's serial stream: torn anywhere, short of bytes, old and new, saved or arriving."""

import struct

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import is_recording, open_recording
from jradar.recordings.points.ti_stream import Parser, packet_points
from tests.recordings.points.ti_writer import MAGIC, old_packet, packet

FRAMES = [[(0.5 * k, 2.0 + k, 0.1, -0.25 * k)] * (k % 4) for k in range(12)]


def stream(frames=FRAMES):
    return [
        packet(k, points, [20.0] * len(points), cycles=k * 20_000_000 % 2**32)
        for k, points in enumerate(frames, 100)
    ]


def numbers(packets):
    return [found.frame for found in packets]


@pytest.mark.parametrize("size", [1, 7, 33, 1000])
def test_packets_torn_anywhere_are_whole_again(size):
    data, parser = b"".join(stream()), Parser()
    found = [
        p for at in range(0, len(data), size) for p in parser.feed(data[at:][:size])
    ]
    assert numbers(found) == [*range(100, 112)] and parser.lost_bytes == 0
    for one, points in zip(found, FRAMES, strict=True):
        columns = packet_points(one)
        table = np.stack([columns[n] for n in ("x", "y", "z", "doppler")], -1)
        np.testing.assert_allclose(table, np.reshape(points, (-1, 4)), rtol=1e-6)


def test_a_packet_is_given_out_with_its_last_byte_and_its_first_bytes_time():
    (first, *_), parser = stream(), Parser()
    assert not parser.feed(first[:50], stamp_s=1.0)
    assert not parser.feed(first[50:-1], stamp_s=2.0)
    (found,) = parser.feed(first[-1:], stamp_s=3.0)
    assert found.stamp_s == 1.0


@pytest.mark.parametrize("at", [3, 9, 13, 45, 60])
def test_lost_bytes_cost_one_packet(at):
    packets = stream()
    packets[5] = packets[5][:at] + packets[5][at + 20 :]
    parser = Parser()
    found = numbers(parser.feed(b"".join(packets)) + parser.finish())
    assert found == [k for k in range(100, 112) if k != 105]
    assert parser.lost_bytes == len(packets[5])


def test_a_stream_may_begin_and_end_within_a_packet():
    data, parser = b"".join(stream())[30:-40], Parser()
    found = numbers(parser.feed(data) + parser.finish())
    assert found == [*range(101, 111)] and parser.lost_bytes > 0


def test_noise_alone_is_never_kept():
    parser = Parser()
    for _ in range(50):
        assert not parser.feed(bytes(range(256)) * 4)
    assert len(parser._bytes) < 8 and len(parser._stamps) == 1


def test_a_size_that_no_packet_has_is_not_waited_for():
    parser = Parser()
    words = 0x03060000, 1 << 30, 0xA6843, 7, 0, 1, 1, 0
    assert not parser.feed(MAGIC + struct.pack("<8I", *words) + bytes(1000))
    assert len(parser._bytes) < 8 and parser.lost_bytes > 1000


def test_a_packet_may_lack_its_last_byte():
    packets = [one[:-1] for one in stream()]
    parser = Parser()
    assert len(parser.feed(b"".join(packets)) + parser.finish()) == 12


def test_a_saved_stream_has_the_boards_times_and_axes(tmp_path):
    path = tmp_path / "out.dat"
    path.write_bytes(b"".join(stream([[(0.5, 2.0, 0.1, -1.5)] * 5] * 12)))
    found = open_recording(path)
    np.testing.assert_allclose(found.points.stamps, 0.1 * np.arange(12), atol=1e-9)
    cloud = found.points[3]
    np.testing.assert_allclose(cloud.xyz, [(2.0, -0.5, 0.1)] * 5, rtol=1e-6)
    np.testing.assert_allclose(cloud.velocity, -1.5)
    np.testing.assert_allclose(cloud.snr, 100.0, rtol=1e-5)
    assert any("y forward" in note and "rotated" in note for note in found.notes)


def test_bytes_in_a_csv_have_the_times_of_their_rows(tmp_path):
    path = tmp_path / "out.csv"
    rows = [
        f'2024-12-16 13:13:{k:02d}.500000001,"{",".join(map(str, one))}"'
        for k, one in enumerate(stream())
    ]
    path.write_text("\n".join(["Timestamp,RawData", *rows]))
    found = open_recording(path)
    np.testing.assert_allclose(found.points.stamps - 1734354780.5, range(12), atol=1e-6)
    assert len(found.points[3].valid) == 3


CFG = """sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 3 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 6 60 0 0 60 1 128 5000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 2
frameCfg 0 1 16 0 100 1 0
sensorStart
"""


def test_the_old_form_needs_the_cfg_for_velocities(tmp_path):
    points = [(k, k - 2, 100, 0.25, 1.5, 0.5) for k in range(5)]
    path, cfg = tmp_path / "old.bin", tmp_path / "old.cfg"
    path.write_bytes(b"".join(old_packet(k, points) for k in range(3)))
    found = open_recording(path)
    (cloud, *_) = found.points
    np.testing.assert_allclose(cloud.xyz, [(1.5, -0.25, 0.5)] * 5)
    assert cloud.velocity is None
    assert any("name the .cfg with --radar" in note for note in found.notes)
    cfg.write_text(CFG)
    found = open_recording(path, cfg, device="awr1642")
    step = found.radar.spec.velocity_resolution_mps
    np.testing.assert_allclose(found.points[0].velocity, step * np.arange(-2, 3))


def test_points_of_other_demos_are_refused_by_name(tmp_path):
    path = tmp_path / "people.dat"
    path.write_bytes(packet(7, [], parts=[(1020, bytes(28))]) * 2)
    with pytest.raises(ValueError, match="frame 7 .*people tracking, TLV 1020"):
        open_recording(path)


def test_other_files_are_not_taken(tmp_path):
    for name, content in [("a.dat", b"1234"), ("b.bin", bytes(64)), ("c.csv", b"1,2")]:
        (tmp_path / name).write_bytes(content)
    assert not is_recording(tmp_path / "a.dat") and not is_recording(tmp_path / "c.csv")
    with pytest.raises(UsageError, match="no radar descriptions next"):
        open_recording(tmp_path / "b.bin")  # which may be of a DCA1000


@pytest.mark.parametrize(
    ("name", "frames", "rate_hz", "said"),
    [
        ("ti_gates_xwr68xx.dat", 101, 10.0, "the board's counter"),
        ("juntingdeng_AWR294X.dat", 101, None, "every velocity is 0"),
        ("adioshun_oob_output_data.bin", 347, 3.33, "SDK 1.2.0.5 sends no velocities"),
        ("lfrogu_drivearound_att6.csv", 300, 29.0, "6 frames are missing"),
    ],
)
def test_real_streams(samples, name, frames, rate_hz, said):
    found = open_recording(samples / "ti_serial" / name)
    assert len(found.points) == frames
    assert any(said in note for note in found.notes)
    assert not any("belong to no whole packet" in note for note in found.notes)
    if rate_hz is None:
        assert found.points.stamps is None
    else:
        step = np.median(np.diff(found.points.stamps))
        assert 1 / step == pytest.approx(rate_hz, rel=0.02)
    assert (found.points[5].xyz[:, 0] >= 0).all()  # x forward
