"""Packet traces: frames of a card, whatever else is on the network."""

import struct
import sys

import numpy as np
import pytest

from jradar.recordings import open_recording
from tests.recordings.dca1000_writer import CFG, as_bytes, random_cubes
from tests.stream.packets import packets_of

dpkt = pytest.importorskip("dpkt", reason="pip install 'jradar[live]'")

CUBES = random_cubes(6)
STREAM = as_bytes(CUBES)
START = 1_700_000_000.0
CARD, HOST = bytes([192, 168, 33, 180]), bytes([192, 168, 33, 30])


def datagram(payload, *, sender=CARD, port=4098, vlan=False, link=1):
    """A frame of the network, byte by byte."""
    udp = struct.pack("!HHHH", 4096, port, 8 + len(payload), 0) + payload
    ip = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0)
    packet = ip + sender + HOST + udp
    kind = struct.pack("!H", 0x0800)
    if link == 101:
        return packet
    if link == 113:
        return bytes(14) + kind + packet
    tag = struct.pack("!HH", 0x8100, 5) if vlan else b""
    return (bytes(12) + tag + kind + packet).ljust(60, b"\0")


def packets(**counters):
    return packets_of(np.frombuffer(STREAM, np.uint8), **counters)


def trace(folder, frames, name="trace.pcap", link=1):
    """A trace with a frame of the network every 10 ms."""
    (folder / "profile.cfg").write_text(CFG)
    path = folder / name
    with path.open("wb") as file:
        if path.suffix == ".pcap":
            writer = dpkt.pcap.Writer(file, linktype=link, snaplen=65535)
        else:
            writer = dpkt.pcapng.Writer(file)
        for number, frame in enumerate(frames):
            writer.writepkt(frame, START + 0.01 * number)
    return path


@pytest.mark.parametrize(
    ("name", "vlan", "link"),
    [
        ("trace.pcap", False, 1),
        ("trace.pcap", True, 1),
        ("trace.pcapng", False, 1),
        ("trace.pcap", False, 101),  # links other than Ethernet
        ("trace.pcap", False, 113),
    ],
)
def test_frames_and_their_times_come_back(tmp_path, name, vlan, link):
    frames = [datagram(p, vlan=vlan, link=link) for p in packets()]
    recording = open_recording(trace(tmp_path, frames, name, link))
    np.testing.assert_array_equal([*recording.cubes], CUBES)
    first = np.arange(6) * 2400 // 1456
    np.testing.assert_allclose(recording.cubes.stamps, START + 0.01 * first, atol=1e-4)
    assert not recording.lost_bytes.any()


def test_other_packets_order_copies_and_losses(tmp_path):
    mine = [datagram(p) for p in packets()]
    mine[3], mine[5] = mine[5], mine[3]
    mine.pop(1)
    mine.insert(7, mine[6])
    foreign = [
        datagram(packets()[1][::-1], sender=HOST),
        datagram(b"x" * 300, port=53),
        bytes(12) + struct.pack("!H", 0x86DD) + bytes(60),
        b"",
    ]
    recording = open_recording(trace(tmp_path, [*foreign, *mine, *foreign]))
    assert recording.lost_bytes.tolist() == [944, 512, 0, 0, 0, 0]
    np.testing.assert_array_equal([*recording.cubes][2:], CUBES[2:])
    assert any("were lost" in note for note in recording.notes)


def test_a_trace_may_begin_and_end_in_the_middle_and_counters_wrap(tmp_path):
    place = 2**48 // 2400 * 2400 - 2 * 2400
    sent = packets(first=2**32 - 3, place=place)
    recording = open_recording(trace(tmp_path, map(datagram, sent[2:-2])))
    assert len(recording.cubes) == 3
    np.testing.assert_array_equal([*recording.cubes][1:], CUBES[2:4])
    assert recording.lost_bytes.tolist() == [512, 0, 0]


def test_a_card_that_started_again_is_refused_with_the_place(tmp_path):
    twice = trace(tmp_path, map(datagram, packets() * 2))
    with pytest.raises(ValueError, match=r"again after 0.100 s, at packet 11"):
        open_recording(twice)


def test_a_trace_that_was_cut_off_is_read_up_to_there(tmp_path):
    path = trace(tmp_path, map(datagram, packets()))
    path.write_bytes(path.read_bytes()[:-700])
    recording = open_recording(path)
    assert len(recording.cubes) == 5
    assert any("ends within a packet" in note for note in recording.notes)


def test_packets_that_were_cut_short_are_refused(tmp_path):
    with pytest.raises(ValueError, match="tcpdump -s 0"):
        open_recording(trace(tmp_path, [datagram(p)[:96] for p in packets()]))


def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch):
    path = trace(tmp_path, map(datagram, packets()))
    monkeypatch.setitem(sys.modules, "dpkt", None)
    with pytest.raises(ImportError, match=r"pip install 'jradar\[live\]'"):
        open_recording(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is damaged or not a packet trace"),
        (b"x" * 1000, "is damaged or not a packet trace"),
        (struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1), "no UDP packets"),
        (struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 9), "link of type 9"),
    ],
)
def test_a_file_that_is_no_trace_of_a_card_is_refused(tmp_path, content, message):
    path = trace(tmp_path, [])
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        open_recording(path)
