"""Batches of packets: what was sent, and from whom, by either way of reading."""

import numpy as np
import pytest

from jradar.stream import sockets


@pytest.fixture(params=["many", "one"])
def reader(request, monkeypatch):
    """A reader of each kind, and the socket that it reads."""
    if request.param == "one":
        monkeypatch.delattr(sockets.ctypes, "CDLL")
    with sockets.udp_socket("127.0.0.1", 0, timeout_s=0.1) as bound:
        yield sockets.batch_reader(bound), bound


def all_packets(read):
    """The packets that wait, with their senders."""
    found = []
    while (batch := read()) is not None:
        for row, size, sender in zip(*batch, strict=True):
            found.append((row[:size].tobytes(), sender.tolist()))
    return found


def test_packets_arrive_whole_in_order_and_with_their_sender(reader):
    read, bound = reader
    sent = [bytes([number]) * (1 + 13 * number) for number in range(100)]
    hosts = [f"127.0.0.{2 + number % 2}" for number in range(100)]
    with (
        sockets.udp_socket("127.0.0.2", 0, timeout_s=1.0) as one,
        sockets.udp_socket("127.0.0.3", 0, timeout_s=1.0) as other,
    ):
        for number, packet in enumerate(sent):
            (one, other)[number % 2].sendto(packet, bound.getsockname())
    found = all_packets(read)
    assert [packet for packet, _ in found] == sent
    expected = [sockets.address_bytes(host).tolist() for host in hosts]
    assert [sender for _, sender in found] == expected
    assert read() is None  # after the socket's time


def test_a_long_packet_is_cut_and_an_empty_one_is_kept(reader):
    read, bound = reader
    with sockets.udp_socket("127.0.0.2", 0, timeout_s=1.0) as card:
        for size in (5000, 0, 3):
            card.sendto(b"x" * size, bound.getsockname())
    sizes = [len(packet) for packet, _ in all_packets(read)]
    assert sizes == [sockets.LONGEST_PACKET, 0, 3]


def test_a_closed_socket_is_an_error(reader):
    read, bound = reader
    bound.close()
    with pytest.raises(OSError, match="descriptor"):
        read()


def test_an_address_has_four_bytes():
    np.testing.assert_array_equal(
        sockets.address_bytes("192.168.33.180"), [192, 168, 33, 180]
    )
