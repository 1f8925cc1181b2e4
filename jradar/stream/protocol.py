"""The messages that TI's DCA1000 capture card sends and understands, over UDP.

    command   0xA55A | code u16 | size u16 | size bytes | 0xEEAA     port 4096
    reply     0xA55A | code u16 | status u16 | 0xEEAA                port 4096
    data      sequence u32 | byte count u48 | at most 1456 bytes     port 4098

All numbers are little-endian. Data packets are numbered from 1. The byte count is the
number of bytes of samples that were sent before, which is the place of the packet in
the stream. Both wrap around. (DCA1000EVM user's guide, SPRUIJ4A, section 5.)
"""

import dataclasses
import enum
import struct

from jradar.errors import UsageError
from jradar.recordings.ti.packets import PAYLOAD

DATA = struct.Struct("<IIH")  # sequence, lower and upper part of the byte count
REPLY = struct.Struct("<HHHH")
START, END = 0xA55A, 0xEEAA
MOST_PACKET = DATA.size + PAYLOAD
SEQUENCES, BYTES = 1 << 32, 1 << 48  # after which the counters begin again
CLOCK_NS = 8  # unit of the packet delay
LEAST_DELAY_US, MOST_DELAY_US = 5, 500
LANES = {4: 1, 2: 2}  # LVDS lanes and their code
RAW_LOG, CAPTURE, ETHERNET, BITS_16, TIMER = 1, 1, 2, 3, 30


class Command(enum.IntEnum):
    """Codes of the commands in use."""

    RESET = 0x01
    CONFIGURE = 0x03
    START = 0x05
    STOP = 0x06
    CONNECT = 0x09
    PACKETS = 0x0B
    VERSION = 0x0E


@dataclasses.dataclass(frozen=True)
class NetworkSpec:
    """Addresses of this machine and of the card; port 0 takes a free one."""

    host: str = "192.168.33.30"
    card: str = "192.168.33.180"
    command_port: int = 4096
    data_port: int = 4098

    def __post_init__(self):
        for name in ("command_port", "data_port"):
            port = getattr(self, name)
            if not 0 <= port < 1 << 16:
                raise UsageError(f"{name} = {port}, expected 0 to 65535")


def pack_command(code: int, data: bytes = b"") -> bytes:
    """Return a command with its data."""
    head = struct.pack("<HHH", START, code, len(data))
    return head + data + struct.pack("<H", END)


def unpack_command(raw: bytes) -> tuple[int, bytes]:
    """Return code and data of a command; ValueError if it is damaged."""
    if len(raw) >= 8:
        start, code, size = struct.unpack_from("<HHH", raw)
        (end,) = struct.unpack_from("<H", raw, len(raw) - 2)
        if (start, end, size) == (START, END, len(raw) - 8):
            return code, raw[6:-2]
    raise ValueError(f"{raw[:16].hex(' ')} ({len(raw)} bytes) is not a card's command")


def pack_reply(code: int, status: int) -> bytes:
    """Return the card's reply to a command; status 0 is success."""
    return REPLY.pack(START, code, status, END)


def unpack_reply(raw: bytes) -> tuple[int, int]:
    """Return code and status of a reply; ValueError if it is damaged."""
    if len(raw) == REPLY.size:
        start, code, status, end = REPLY.unpack(raw)
        if (start, end) == (START, END):
            return code, status
    raise ValueError(f"{raw[:16].hex(' ')} ({len(raw)} bytes) is not a card's reply")


def configuration(*, lanes: int = 2) -> bytes:
    """Return the data of CONFIGURE: 16-bit samples over Ethernet, not separated.

    Boards of the series 12 and 14 have four LVDS lanes, all others two.
    """
    return bytes([RAW_LOG, LANES[lanes], CAPTURE, ETHERNET, BITS_16, TIMER])


def packet_delay(delay_us: float) -> bytes:
    """Return the data of PACKETS: the pause between two packets."""
    if not LEAST_DELAY_US <= delay_us <= MOST_DELAY_US:
        raise UsageError(
            f"packet delay {delay_us:g} us, expected {LEAST_DELAY_US} to "
            f"{MOST_DELAY_US}"
        )
    return struct.pack("<HHH", 1470, round(1000 * delay_us / CLOCK_NS), 0)


def pack_packet(sequence: int, byte_count: int, samples: bytes | memoryview) -> bytes:
    """Return a data packet; counters beyond their width wrap around."""
    place = byte_count % BYTES
    header = DATA.pack(sequence % SEQUENCES, place & 0xFFFFFFFF, place >> 32)
    return header + samples


def unpack_header(packet: bytes | memoryview) -> tuple[int, int]:
    """Return sequence number and byte count of a data packet."""
    sequence, low, high = DATA.unpack_from(packet)
    return sequence, high << 32 | low
