"""An emulated card and a receiver on this machine's loopback."""

import contextlib
import time

import pytest

from jradar.stream.emulator import Emulator
from jradar.stream.receiver import Receiver
from jradar.stream.sockets import loopback_network

PATIENCE_S = 60.0  # a test that waits longer has failed
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


def wait_until(condition, what):
    """Wait until `condition()` holds; fail after a minute."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"waited {PATIENCE_S:g} s for {what}"
        time.sleep(0.005)


def settled(emulator, receiver):
    """Wait until the emulator has finished and all its packets have been received.

    Few packets fit into the socket, so that none can be lost there.
    """
    wait_until(emulator.finished.is_set, "the end of the recording")
    wait_until(
        lambda: receiver.counts.packets >= emulator.sent.packets, "the last packet"
    )


def taken(receiver):
    """All frames that wait."""
    frames = []
    while (frame := receiver.take(0.0)) is not None:
        frames.append(frame)
    return frames
