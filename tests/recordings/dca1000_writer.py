"""DCA1000 captures written byte by byte, for tests."""

import struct

import numpy as np

CFG = """\
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 0 1 1
profileCfg 0 77 267 7 57.14 0 0 70 1 10 5209 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 2 0 0 0 0 0 2
frameCfg 0 2 5 0 100 1 0
"""
SHAPE = (3, 4, 5, 10)  # tx, rx, chirp, sample: 2,400 bytes, not a multiple of 1,456
FRAME, PAYLOAD = 2400, 1456
TWO_LANES = {  # the words of samples a and b
    "IIQQ": lambda a, b: (a.real, b.real, a.imag, b.imag),
    "QQII": lambda a, b: (a.imag, b.imag, a.real, b.real),
    "IQIQ": lambda a, b: (a.real, a.imag, b.real, b.imag),
    "QIQI": lambda a, b: (a.imag, a.real, b.imag, b.real),
}


def random_cubes(frames=3, shape=SHAPE, seed=0):
    parts = np.random.default_rng(seed).integers(-2000, 2000, (2, frames, *shape))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def as_bytes(cubes, order="IIQQ"):
    """The stream of frames [frame, tx, rx, chirp, sample], word by word."""
    words = []
    for frame in cubes:
        tx, rx, chirps, samples = frame.shape
        for chirp, t in np.ndindex(chirps, tx):
            if order in TWO_LANES:
                for r, n in np.ndindex(rx, samples // 2):
                    pair = frame[t, r, chirp, 2 * n : 2 * n + 2]
                    words += TWO_LANES[order](*pair)
            else:
                for n in range(samples):
                    values = frame[t, :, chirp, n]
                    halves = [[*values.real], [*values.imag]]
                    words += sum(halves if order == "I4Q4" else halves[::-1], [])
    return struct.pack(f"<{len(words)}h", *map(int, words))


def packet(sequence, place, samples, length=b""):
    """A data packet of the card; its counters wrap around. Files hold its length."""
    head = struct.pack("<I", sequence % 2**32) + length
    return head + struct.pack("<Q", place % 2**48)[:6] + bytes(samples)


def as_packets(stream, sizes=None):
    """(sequence, byte count, samples) of a stream cut into `sizes`."""
    packets, at = [], 0
    for size in sizes or [PAYLOAD] * (-(-len(stream) // PAYLOAD)):
        packets.append((len(packets) + 1, at, stream[at : at + size]))
        at += size
    return [packet for packet in packets if packet[2]]


def with_headers(packets, header=14):
    length = {14: lambda data: struct.pack("<I", len(data)), 10: lambda _: b""}[header]
    return b"".join(packet(*one, length(one[2])) for one in packets)
