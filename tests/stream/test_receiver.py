"""Receiver and emulated card: what is sent arrives; faults are counted and named."""

import numpy as np
import pytest

from jradar.stream.emulator import FaultSpec
from jradar.stream.receiver import Receiver
from jradar.stream.sockets import loopback_network, udp_socket
from tests.stream import loops
from tests.stream.packets import packet, packets_of, random_frames

pytestmark = loops.RACES
FRAMES = random_frames(20)  # 33 packets, which any socket holds
BYTES = [frame.tobytes() for frame in FRAMES]


def test_frames_arrive_bit_by_bit():
    with loops.loop(BYTES) as (emulator, receiver):
        emulator.start()
        loops.settled(emulator, receiver)
        frames = loops.taken(receiver)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES)
    assert receiver.counts.placed == emulator.sent.packets == 33
    assert not receiver.dropped and not receiver.counts.lost_bytes


@pytest.mark.parametrize("seed", range(3))
def test_faults_of_the_network_are_all_accounted_for(seed):
    """While both counters wrap around."""
    place = 2**48 // 2400 * 2400 - 5 * 2400
    faults = FaultSpec(loss=0.3, reorder=8, duplicate=0.2, seed=seed)
    counters = {"first_sequence": 2**32 - 9, "first_byte": place}
    with loops.loop(BYTES, faults=faults, **counters) as (emulator, receiver):
        emulator.start()
        loops.settled(emulator, receiver)
        receiver.close()
        frames, counts, sent = loops.taken(receiver), receiver.counts, emulator.sent
    assert counts.packets == sent.packets
    assert counts.packets == counts.placed + counts.repeated + counts.late
    assert sent.packets == 33 - sent.lost + sent.repeated
    assert sent.lost and sent.repeated
    assert len(frames) == counts.frames
    for frame in frames:
        number = frame.number - place // 2400
        same = frame.data == FRAMES[number]
        assert same.all() or frame.lost_bytes and not frame.data[~same].any()


def test_the_newest_frame_wins_and_the_others_are_counted():
    with loops.loop(BYTES, waiting=1) as (emulator, receiver):
        emulator.start()
        loops.settled(emulator, receiver)
        (last,) = loops.taken(receiver)
    np.testing.assert_array_equal(last.data, FRAMES[-1])
    assert receiver.dropped == 19
    assert receiver.counts.frames == 1 + receiver.dropped


def test_a_flood_of_foreign_packets_changes_nothing():
    with (
        loops.receiving(2400) as (receiver, card),
        udp_socket("127.0.0.3", 0, timeout_s=1.0) as stranger,
    ):
        for packet in packets_of(FRAMES):
            loops.deliver(stranger, receiver, [packet[::-1]] * 20)
            loops.deliver(card, receiver, [packet])
        assert receiver.foreign_sender == "127.0.0.3"
        frames = loops.taken(receiver)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES)
    assert receiver.counts.foreign == 33 * 20
    text = "660 packets from other senders, the last from 127.0.0.3"
    assert text in receiver.oddity()
    assert "longer than" not in receiver.oddity()


def test_packets_that_are_no_stream_are_named_by_their_fault():
    with loops.receiving(2400) as (receiver, card):
        assert not receiver.oddity()
        loops.deliver(card, receiver, [b"x" * 2000] * 300)
        assert "300 packets without a header or longer" in receiver.oddity()
        counters = np.random.default_rng(0).integers(0, 2**32, (300, 2)).tolist()
        loops.deliver(card, receiver, (packet(*pair, b"x" * 100) for pair in counters))
        assert "do two cards have this address?" in receiver.oddity()


def test_silence_is_explained():
    with loops.receiving(2400, "127.0.0.3") as (receiver, stranger):
        assert not receiver.silence(60.0)
        loops.wait_until(lambda: receiver.silence(0.3), "silence")
        assert "was the board started" in receiver.silence(0.3)
        loops.deliver(stranger, receiver, [b"x" * 100])
        loops.wait_until(lambda: receiver.silence(0.3), "silence")
        assert "the last from 127.0.0.3: is that the card?" in receiver.silence(0.3)


def test_a_taken_port_and_an_address_that_is_not_ours_are_named():
    network = loopback_network()
    for _ in range(2):  # the port is free after the end
        with Receiver(2400, network):
            taken_by_us = rf"port {network.data_port} of 127.0.0.1 is"
            with pytest.raises(OSError, match=taken_by_us):
                Receiver(2400, network)
    with pytest.raises(OSError, match="has no address 192.0.2.1: give it"):
        udp_socket("192.0.2.1", 0, timeout_s=1.0)


def test_a_small_buffer_of_the_system_is_noted():
    with Receiver(1 << 30, loopback_network()) as receiver:
        assert "sudo sysctl -w net.core.rmem_max=2147483648" in receiver.note


def test_a_fault_in_the_thread_is_raised_where_frames_are_taken():
    with loops.loop(BYTES) as (emulator, receiver):
        receiver._assembler._deliver = lambda frame: 1 / 0
        emulator.start()
        with pytest.raises(ZeroDivisionError):
            while receiver.take(60.0) is not None:
                pass
