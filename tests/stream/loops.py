"""An emulated card and a receiver on this machine's loopback."""

import contextlib
import time

import pytest

from jradar.stream.emulator import Emulator
from jradar.stream.receiver import Receiver
from jradar.stream.sockets import loopback_network, udp_socket

PATIENCE_S = 60.0  # a test that waits longer has failed
AHEAD = 20  # packets, which any socket holds
# The system drops packets that a receiver on a crowded machine takes too late.
RACES = pytest.mark.flaky(reruns=2, reruns_delay=5)


@contextlib.contextmanager
def loop(frames, *, period_s=0.005, waiting=1000, **options):
    """An emulator that is ready to send, and a receiver that keeps every frame."""
    network = loopback_network()
    with (
        Receiver(len(frames[0]), network, waiting=waiting) as receiver,
        Emulator(frames, network, period_s=period_s, **options) as emulator,
    ):
        yield emulator, receiver


@contextlib.contextmanager
def receiving(size, sender="127.0.0.2", *, waiting=1000):
    """A receiver of frames of so many bytes, and a socket of the card or of another."""
    with (
        Receiver(size, loopback_network(), waiting=waiting) as receiver,
        udp_socket(sender, 0, timeout_s=1.0) as socket,
    ):
        yield receiver, socket


def wait_until(condition, what):
    """Wait until `condition()` holds; fail after a minute."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"waited {PATIENCE_S:g} s for {what}"
        time.sleep(0.005)


def deliver(sender, receiver, packets):
    """Send packets to a receiver, never more than `AHEAD` of those it has received."""
    network, before = receiver.network, receiver.counts.packets
    for sent, one in enumerate(packets, 1):
        sender.sendto(one, (network.host, network.data_port))
        wait_until(
            lambda n=sent: receiver.counts.packets >= before + n - AHEAD, "a packet"
        )
    wait_until(lambda: receiver.counts.packets >= before + sent, "the last packet")


def settled(emulator, receiver):
    """Wait until the emulator has finished and all its packets have been received.

    Few packets fit into the socket, so that none can be lost there.
    """
    wait_until(emulator.finished.is_set, "the end of the recording")
    counts = receiver.counts
    wait_until(lambda: counts.packets >= emulator.sent.packets, "the last packet")


def taken(receiver):
    """All frames that wait."""
    frames = []
    while (frame := receiver.take(0.0)) is not None:
        frames.append(frame)
    return frames
