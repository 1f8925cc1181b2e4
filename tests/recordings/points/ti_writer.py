"""Packets of TI's demos, written from the description of their bytes."""

import struct

MAGIC = b"\x02\x01\x04\x03\x06\x05\x08\x07"
SDK3, SDK1 = 0x03060000, 0x01020005


def packet(number, points, snr=None, *, version=SDK3, cycles=0, parts=()):
    """Points are x, y, z, v; SNRs in dB. `parts` are further TLVs (type, payload)."""
    tlvs = []
    if points:
        tlvs.append((1, b"".join(struct.pack("<4f", *point) for point in points)))
    if snr:
        rows = (struct.pack("<2h", round(10 * value), 300) for value in snr)
        tlvs.append((7, b"".join(rows)))
    return whole(number, len(points), [*tlvs, *parts], version=version, cycles=cycles)


def old_packet(number, points, *, shift=9, cycles=0):
    """Points are range index, Doppler index, peak, x, y, z in metres."""
    rows = []
    for range_index, doppler, peak, *xyz in points:
        places = [round(value * 2**shift) for value in xyz]
        rows.append(struct.pack("<HhH3h", range_index, doppler, peak, *places))
    payload = struct.pack("<HH", len(points), shift) + b"".join(rows)
    tlvs = [(1, payload), (6, bytes(24))]
    return whole(number, len(points), tlvs, version=SDK1, cycles=cycles)


def whole(number, objects, tlvs, *, version, cycles):
    body = b"".join(struct.pack("<II", kind, len(p)) + p for kind, p in tlvs)
    size = -(-(40 + len(body)) // 32) * 32
    words = (version, size, 0xA6843, number, cycles, objects, len(tlvs), 0)
    return (MAGIC + struct.pack("<8I", *words) + body).ljust(size, b"\0")
