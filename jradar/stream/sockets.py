"""UDP sockets on this machine's addresses, with errors that say what to do."""

import errno
import socket
import struct

from jradar.stream.protocol import NetworkSpec

LOOPBACK = "127.0.0.1", "127.0.0.2"  # this machine and an emulated card


def udp_socket(host: str, port: int, *, timeout_s: float) -> socket.socket:
    """Return a bound socket whose `recv` raises BlockingIOError after `timeout_s`.

    Raises OSError, with the fix, if the port is taken or the address is not ours.
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
            f"{local} only talks to this machine itself, {other} lies beyond it: give "
            "both --host and --card addresses of one network; `ip addr` lists this "
            "machine's"
        )
    return OSError(f"{target} cannot be reached from {source}: {reason}")


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
