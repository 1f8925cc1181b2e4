"""UDP sockets on this machine's addresses, and the packets that wait in one.

Errors say what to do. Packets are read in batches of up to 64. On Linux one system
call, `recvmmsg`, reads a batch; elsewhere a call reads one packet. A thread releases
Python's lock for each call, and then waits for busy threads to get it back. So there
should be few calls.
"""

import ctypes
import errno
import os
import socket
import struct
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt8

from jradar.stream.protocol import NetworkSpec

LOOPBACK = "127.0.0.1", "127.0.0.2"  # this machine and an emulated card
LONGEST_PACKET = 2048  # a longer one is cut, and counts as malformed
MOST_PACKETS = 64  # in a batch
WAIT_FOR_ONE = 0x10000  # MSG_WAITFORONE: wait for the first packet only


class Batch(NamedTuple):
    """Packets in the order of their arrival; the next batch overwrites them."""

    data: UInt8[np.ndarray, "packet byte"]
    sizes: Int[np.ndarray, " packet"]  # bytes of each
    senders: UInt8[np.ndarray, "packet 4"]  # addresses


def udp_socket(host: str, port: int, *, timeout_s: float) -> socket.socket:
    """Return a bound socket whose `recv` raises BlockingIOError after `timeout_s`.

    Raises OSError, with the fix, if the port is taken, or the address is not one of
    this machine.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        seconds, rest = divmod(max(timeout_s, 1e-3), 1)
        limit = struct.pack("@ll", int(seconds), int(rest * 1e6))
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise OSError(_reason(error, host, port)) from error
    return bound


def loopback_network() -> NetworkSpec:
    """Return addresses for an emulated card on this machine, with free ports."""
    ports = [_free_port() for _ in range(2)]
    return NetworkSpec(*LOOPBACK, *ports)


def not_sent(error: OSError, source: str, target: str) -> OSError:
    """Return the error for a packet that could not be sent, with what to change."""
    reason = error.strerror or str(error)
    loops = [address.startswith("127.") for address in (source, target)]
    if loops[0] != loops[1] and error.errno in (errno.EINVAL, errno.ENETUNREACH):
        local, other = (source, target) if loops[0] else (target, source)
        reason = (
            f"{local} only talks to this machine itself, and {other} is another one: "
            "give both --host and --card addresses of one network; `ip addr` lists "
            "this machine's"
        )
    return OSError(f"{target} cannot be reached from {source}: {reason}")


def address_bytes(host: str) -> UInt8[np.ndarray, "4"]:
    """Return the four bytes of an IPv4 address."""
    return np.frombuffer(socket.inet_aton(host), np.uint8)


def batch_reader(bound: socket.socket) -> Callable[[], Batch | None]:
    """Return a function that waits for packets and returns them, or None if none came.

    It waits as long as a `recv` of the socket does.
    """
    try:
        call = ctypes.CDLL(None, use_errno=True).recvmmsg
    except (AttributeError, OSError, TypeError):  # not Linux
        return _Single(bound)
    return _Many(bound, call)


def _free_port() -> int:
    """Return a port that is free on both addresses of the loopback."""
    for _ in range(100):
        with udp_socket(LOOPBACK[0], 0, timeout_s=1.0) as first:
            port = first.getsockname()[1]
            try:
                udp_socket(LOOPBACK[1], port, timeout_s=1.0).close()
            except OSError:
                continue
            return port
    raise OSError(f"no port is free on both {' and '.join(LOOPBACK)}")


def _reason(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return (
            f"UDP port {port} of {host} is taken by another program: end it (another "
            f"jradar, mmWave Studio, a ROS node?); `ss -ulpn` shows which it is"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return (
            f"this machine has no address {host}: give it to the interface of the "
            f"card, `sudo ip addr add {host}/24 dev eth0`, or name another with --host"
        )
    return f"UDP port {port} of {host} cannot be opened: {error.strerror or error}"


# The system's sockaddr_in, iovec, msghdr and mmsghdr.
_ADDRESS = np.dtype([("family", "u2"), ("port", "u2"), ("host", "u1", 4), ("", "u8")])
_BUFFER = np.dtype([("base", np.uintp), ("size", np.uintp)])
_HEADER = np.dtype(
    [
        ("name", np.uintp),
        ("name_size", "u4"),
        ("buffers", np.uintp),
        ("num_buffers", np.uintp),
        ("control", np.uintp),
        ("control_size", np.uintp),
        ("flags", "i4"),
    ],
    align=True,
)
_MESSAGE = np.dtype([("header", _HEADER), ("received", "u4")], align=True)


class _Many:
    """Reads through `recvmmsg` into arrays that it keeps."""

    def __init__(self, bound: socket.socket, call: Callable):
        self._socket, self._call = bound, call
        self._data = np.zeros((MOST_PACKETS, LONGEST_PACKET), np.uint8)
        self._names = np.zeros(MOST_PACKETS, _ADDRESS)
        self._buffers = np.zeros(MOST_PACKETS, _BUFFER)
        self._messages = np.zeros(MOST_PACKETS, _MESSAGE)
        self._buffers["base"] = _addresses(self._data)
        self._buffers["size"] = LONGEST_PACKET
        header = self._messages["header"]
        header["name"], header["name_size"] = _addresses(self._names), _ADDRESS.itemsize
        header["buffers"], header["num_buffers"] = _addresses(self._buffers), 1
        self._place = ctypes.c_void_p(self._messages.ctypes.data)

    def __call__(self) -> Batch | None:
        file = self._socket.fileno()
        count = self._call(file, self._place, MOST_PACKETS, WAIT_FOR_ONE, None)
        if count > 0:
            sizes, hosts = self._messages["received"], self._names["host"]
            return Batch(self._data[:count], sizes[:count], hosts[:count])
        code = ctypes.get_errno()
        if code in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EINTR):
            return None
        raise OSError(code, os.strerror(code))


def _addresses(rows: np.ndarray) -> np.ndarray:
    """Return the place in memory of each row."""
    return rows.ctypes.data + rows.strides[0] * np.arange(len(rows), dtype=np.uintp)


class _Single:
    """Reads one packet a call."""

    def __init__(self, bound: socket.socket):
        self._socket, self._data = bound, np.zeros((1, LONGEST_PACKET), np.uint8)

    def __call__(self) -> Batch | None:
        try:
            size, (host, _) = self._socket.recvfrom_into(self._data[0].data)
        except (BlockingIOError, InterruptedError):
            return None
        return Batch(self._data, np.array([size]), address_bytes(host)[None])
