"""Commands: an emulated card obeys them; a card that is absent or refuses is named."""

import dataclasses
import threading

import numpy as np
import pytest

from jradar.stream.card import Card
from jradar.stream.emulator import Emulator
from jradar.stream.protocol import Command, pack_reply, unpack_command
from jradar.stream.sockets import loopback_network, udp_socket
from tests.stream.loops import RACES, loop, settled, taken, wait_until
from tests.stream.packets import random_frames

pytestmark = RACES
FRAMES = random_frames(100)  # 165 packets: more than the window
BYTES = [frame.tobytes() for frame in FRAMES]


def test_a_card_is_set_up_started_and_stopped():
    with loop(BYTES[:20]) as (emulator, receiver):
        with Card(receiver.network, timeout_s=30.0) as card:
            card.command(Command.RESET)
            card.set_up()
            assert not emulator.sent.packets
            card.start()
            settled(emulator, receiver)
            card.stop()
        frames = taken(receiver)
    np.testing.assert_array_equal([frame.data for frame in frames], FRAMES[:20])


def test_a_card_that_starts_again_begins_with_its_first_frame():
    with loop(BYTES) as (emulator, receiver):
        with Card(receiver.network, timeout_s=30.0) as card:
            for _ in range(2):
                card.start()
                settled(emulator, receiver)
                card.stop()
        receiver.close()
        frames = taken(receiver)
    whole = [frame for frame in frames if not frame.lost_bytes]
    for frame in whole:
        np.testing.assert_array_equal(frame.data, FRAMES[frame.number % 100])
    assert receiver.counts.restarts == 1 and whole[-1].number == 199


def test_a_refusal_and_strange_replies():
    """The reply to another command and damaged bytes are passed over."""
    network = loopback_network()
    with (
        udp_socket(network.card, network.command_port, timeout_s=60.0) as other,
        Card(network, timeout_s=60.0) as card,
    ):

        def answer():
            raw, sender = other.recvfrom(100)
            assert unpack_command(raw) == (Command.START, b"")
            other.sendto(b"nonsense", sender)
            other.sendto(pack_reply(Command.STOP, 0), sender)
            other.sendto(pack_reply(Command.START, 1), sender)

        thread = threading.Thread(target=answer)
        thread.start()
        try:
            with pytest.raises(OSError, match=r"refused START \(status 1\)"):
                card.start()
        finally:
            thread.join()


def test_a_silent_card_and_one_that_another_program_commands_are_named():
    network = loopback_network()
    with Card(network, timeout_s=0.05) as card:
        with pytest.raises(TimeoutError, match="did not answer CONNECT within 0.05 s"):
            card.connect()
        with pytest.raises(OSError, match="is taken by another program"):
            Card(network)
    network = dataclasses.replace(network, card="198.51.100.1")
    with Card(network) as card:
        with pytest.raises(OSError, match=r"127\.0\.0\.1 only talks to this machine"):
            card.connect()


def test_a_recording_that_cannot_be_read_ends_the_sending_with_its_error():
    class Damaged(list):
        def __getitem__(self, index):
            raise ValueError("frame 0 is damaged")

    with Emulator(Damaged([b""]), loopback_network(), period_s=0.0) as emulator:
        emulator.start()
        assert emulator.finished.wait(60.0)
        assert str(emulator.fault) == "frame 0 is damaged"


def test_a_stopped_card_begins_again_with_the_next_start():
    with loop(BYTES, repeat=True) as (emulator, receiver):
        for frames in (0, len(BYTES)):
            emulator.start()
            wait_until(lambda n=frames: receiver.counts.frames > n, "a frame")
            emulator.stop()
            assert not emulator.finished.is_set()
        first = taken(receiver)[0]
    np.testing.assert_array_equal(first.data, FRAMES[0])
