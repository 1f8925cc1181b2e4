"""Packets of a card, written by hand: counters, samples, and what a network does."""

import numpy as np

from jradar.stream.assembler import Assembler
from tests.recordings.dca1000_writer import PAYLOAD, packet


def random_frames(count, size=2400, seed=0):
    """Frames of random bytes, `[frame, byte]`."""
    return np.random.default_rng(seed).integers(0, 256, (count, size), np.uint8)


def packets_of(frames, *, first=1, place=0):
    """The packets of a stream of frames that begins at `place` with number `first`."""
    stream = np.ascontiguousarray(frames).tobytes()
    return [
        packet(first + i, place + at, stream[at : at + PAYLOAD])
        for i, at in enumerate(range(0, len(stream), PAYLOAD))
    ]


def spoiled(packets, *, loss=0.0, reorder=0, duplicate=0.0, seed=0, steady=2):
    """Packets that arrive, and how many were sent.

    The first and last `steady` arrive in order, so that the stream begins and ends.
    """
    rng = np.random.default_rng(seed)
    arriving = []
    for i, one in enumerate(packets):
        edge = i < steady or i >= len(packets) - steady
        for copy in range(1 + (rng.random() < duplicate)):
            if edge or rng.random() >= loss:
                shift = 0 if edge and not copy else rng.uniform(0, reorder + 1)
                arriving.append((i + shift, one))
    return [one for _, one in sorted(arriving, key=lambda pair: pair[0])]


def assemble(packets, size, *, flush=True, **options):
    """The frames of packets, and the counts."""
    frames = []
    assembler = Assembler(size, frames.append, **options)
    for one in packets:
        assembler.add(one)
    if flush:
        assembler.flush()
    return frames, assembler.counts
