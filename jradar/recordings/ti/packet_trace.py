"""Packets of a DCA1000 in a capture of the network: .pcap or .pcapng.

    tcpdump -i eth0 -w capture.pcap udp port 4098

A trace may begin and end anywhere: frames are counted from the first one in it, and an
unfinished last one is left out. Frames get the times at which their first packets
arrived. Containers are parsed by the package dpkt.
"""

import os
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jradar.errors import optional, parsing
from jradar.files import open_file
from jradar.options.sensor import RadarSpec
from jradar.recordings.recording import Format, Recording
from jradar.recordings.ti.dca1000 import (
    bytes_of_frame,
    described_samples,
    recording_of_samples,
)
from jradar.recordings.ti.packets import PAYLOAD, REORDERED, Files, Packets

HEADER_BYTES = 10
DATA_PORT = 4098
COUNT_BITS = 48
CUT_OFF = "the trace ends within a packet, which was left out"
SUFFIXES = (".pcap", ".pcapng", ".cap")
# Where link layers put the type of the next one, and how long they are.
LINKS = {0: (None, 4), 1: (12, 14), 101: (None, 0), 113: (14, 16), 276: (0, 20)}
IPV4, VLAN, UDP = 0x0800, (0x8100, 0x88A8), 17
PLAIN_IPV4 = 0x45  # first byte of a header without options, as the card sends it


class Datagram(NamedTuple):
    """One UDP packet of a trace: where its payload lies in the file."""

    time_s: float
    sender: bytes
    port: int  # of the receiver
    offset: int
    size: int
    header: bytes  # the first bytes of the payload


def open_packet_trace(
    path: Path | str,
    description: Path | str | None = None,
    *,
    iq_order: str | None = None,
    device: str | None = None,
) -> Recording:
    """Open the capture in a trace; options as in `open_dca1000`.

    Raises ValueError for a trace without packets of a card, or with two captures, and
    ImportError if dpkt is missing.
    """
    path = Path(path)
    described = described_samples(path, description, iq_order=iq_order, device=device)
    packets, times, notes = _packets(path, described.radar)
    frame_bytes = bytes_of_frame(described.radar)
    count = packets.size // frame_bytes
    first = np.searchsorted(packets.end, np.arange(count) * frame_bytes, "right")
    recording = recording_of_samples(
        path, path.stem, packets, described, allow_partial=True, stamps=times[first]
    )
    return recording._replace(notes=(*notes, *recording.notes))


READER = Format(
    "a packet trace (.pcap) of a DCA1000 with its log, .cfg or .toml",
    lambda path: path.suffix in SUFFIXES,
    open_packet_trace,
    ("description", "iq_order", "device"),
)


def _packets(
    path: Path, radar: RadarSpec
) -> tuple[Packets, Float[np.ndarray, " packet"], tuple[str, ...]]:
    """Return the card's packets, sorted by their places, their times, and notes."""
    datagrams, notes = _datagrams(path)
    rows = []
    for datagram in _of_the_card(path, datagrams):
        low, high = struct.unpack_from("<IH", datagram.header, 4)
        payload = datagram.size - HEADER_BYTES
        if 0 < payload <= PAYLOAD:
            place = datagram.offset + HEADER_BYTES
            rows.append((high << 32 | low, place, payload, datagram.time_s))
    if not rows:
        raise ValueError(f"{path} holds no data packets of a DCA1000")
    columns = zip(*rows, strict=True)
    counted, offset, payload, times = map(np.array, columns)
    start = _unwrapped(path, counted.astype(np.int64), times)
    frame = bytes_of_frame(radar)
    start -= start.min() // frame * frame
    found = Packets.of(Files.of([path]), start, offset, payload)
    return found, times[np.argsort(start, kind="stable")].astype(float), notes


def _unwrapped(
    path: Path, counted: Int[np.ndarray, " packet"], times: np.ndarray
) -> Int[np.ndarray, " packet"]:
    """Return byte counts that keep rising where the card's 48-bit counter wraps."""
    whole = 1 << COUNT_BITS
    steps = (np.diff(counted) + whole // 2) % whole - whole // 2
    place = counted[0] + np.append(0, np.cumsum(steps))
    behind = np.maximum.accumulate(place) - place
    # A card that starts again counts from 0: far back, or at once after a short one.
    again = (behind > REORDERED) | ((counted == 0) & (behind > 0))
    if again.any():
        at = int(again.argmax())
        seconds = times[at] - times[0]
        raise ValueError(
            f"{path}: the card was started again after {seconds:.3f} s, at packet "
            f"{at + 1:,}: cut the trace there, such as with editcap"
        )
    return place


def _of_the_card(path: Path, datagrams: list[Datagram]) -> Iterator[Datagram]:
    """Yield the packets to the data port, or else to the busiest one, of one sender."""
    whole = [d for d in datagrams if len(d.header) == HEADER_BYTES]
    ports = Counter(d.port for d in whole)
    if not ports:
        raise ValueError(f"{path} holds no UDP packets with samples")
    port = DATA_PORT if DATA_PORT in ports else ports.most_common(1)[0][0]
    senders = Counter(d.sender for d in whole if d.port == port)
    sender, _ = senders.most_common(1)[0]
    yield from (d for d in whole if (d.port, d.sender) == (port, sender))


def _datagrams(path: Path) -> tuple[list[Datagram], tuple[str, ...]]:
    """Return all UDP packets of a trace, and notes about its end."""
    dpkt = optional("dpkt", need="packet traces need dpkt", extra="live")
    found, size = [], path.stat().st_size
    with open_file(path) as file, parsing(path, "a packet trace (.pcap or .pcapng)"):
        reader: Any = dpkt.pcap.UniversalReader(file)
        link, is_ng = reader.datalink(), isinstance(reader, dpkt.pcapng.Reader)
        if link not in LINKS:
            raise ValueError(
                f"{path} was captured on a link of type {link}, expected one of "
                f"{sorted(LINKS)}: 1 is Ethernet"
            )
        try:
            for time_s, raw in reader:
                if (udp := _place_of_udp(raw, link)) is None:
                    continue
                end = _end_of_data(file, len(raw)) if is_ng else file.tell()
                _, port, length = struct.unpack_from("!HHH", raw, udp)
                if (missing := udp + length - len(raw)) > 0:
                    if end >= size:
                        return found, (CUT_OFF,)
                    if port == DATA_PORT:
                        raise ValueError(
                            f"{path} holds only the first {len(raw)} bytes of a packet "
                            f"of {len(raw) + missing}: capture again with `tcpdump -s "
                            "0`"
                        )
                header = raw[udp + 8 : udp + 8 + HEADER_BYTES]
                sender, offset = raw[udp - 8 : udp - 4], end - len(raw) + udp + 8
                found.append(
                    Datagram(float(time_s), sender, port, offset, length - 8, header)
                )
        except dpkt.dpkt.NeedData:
            return found, (CUT_OFF,)
    return found, ()


def _end_of_data(file: Any, size: int) -> int:
    """Return where the data of the block of a .pcapng end that was just read."""
    end = file.tell()
    (total,) = struct.unpack("<I", os.pread(file.fileno(), 4, end - 4))
    (kind,) = struct.unpack("<I", os.pread(file.fileno(), 4, end - total))
    return end - total + (28 if kind == 6 else 12) + size


def _place_of_udp(raw: bytes, link: int) -> int | None:
    """Return where the header of UDP begins; None for other protocols."""
    at, begin = LINKS[link]
    if at is not None:
        kind = int.from_bytes(raw[at : at + 2], "big")
        while link == 1 and kind in VLAN:
            kind, begin = int.from_bytes(raw[begin + 2 : begin + 4], "big"), begin + 4
        if kind != IPV4:
            return None
    ip = raw[begin : begin + 20]
    if len(ip) < 20 or ip[0] != PLAIN_IPV4 or ip[9] != UDP:
        return None
    udp = begin + len(ip)
    return udp if len(raw) >= udp + 8 else None
