"""Commands to a DCA1000 capture card: connect, configure, start, stop."""

import errno
import time

from jradar.stream.protocol import (
    Command,
    NetworkSpec,
    configuration,
    pack_command,
    packet_delay,
    unpack_reply,
)
from jradar.stream.sockets import not_sent, udp_socket

TRIES = 5  # of CONNECT: after CONFIGURE the card does not answer for a while


class Card:
    """A card that answers on its command port; a `with` block frees the port."""

    def __init__(self, network: NetworkSpec, *, timeout_s: float = 1.0):
        """Bind this machine's command port; OSError if it is taken."""
        self.network, self.timeout_s = network, timeout_s
        host, port = network.host, network.command_port
        self._socket = udp_socket(host, port, timeout_s=min(timeout_s, 0.1))

    def __enter__(self) -> "Card":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Free the command port."""
        self._socket.close()

    def set_up(self, *, lanes: int = 2, delay_us: float = 25.0) -> None:
        """Connect and configure the card.

        `lanes` is the board's number of LVDS lanes: 4 for the series 12 and 14, else 2.
        `delay_us` is the pause between packets.
        """
        self.connect()
        self.command(Command.PACKETS, packet_delay(delay_us))
        self.command(Command.CONFIGURE, configuration(lanes=lanes))
        self.connect()

    def connect(self) -> None:
        """Ask several times whether the card is there."""
        for left in reversed(range(TRIES)):
            try:
                self.command(Command.CONNECT)
                return
            except TimeoutError:
                if not left:
                    raise

    def start(self) -> None:
        """Start recording. Start the board afterwards: byte 0 then begins a frame."""
        self.command(Command.START)

    def stop(self) -> None:
        """Stop recording."""
        self.command(Command.STOP)

    def command(self, code: Command, data: bytes = b"") -> None:
        """Send a command; OSError if the card does not answer or refuses it."""
        if status := self._ask(code, data):
            raise OSError(
                f"the card at {self.network.card} refused {code.name} (status "
                f"{status}): switch it off and on, and try again"
            )

    def _ask(self, code: Command, data: bytes = b"") -> int:
        """Return the status in the reply; other messages are ignored."""
        network = self.network
        try:
            self._socket.sendto(
                pack_command(code, data), (network.card, network.command_port)
            )
        except OSError as error:
            raise not_sent(error, network.host, network.card) from error
        end = time.monotonic() + self.timeout_s
        while time.monotonic() < end:
            try:
                raw, (sender, _) = self._socket.recvfrom(2048)
                answered, status = unpack_reply(raw)
            except (BlockingIOError, ValueError):
                continue
            except OSError as error:
                if error.errno != errno.ECONNREFUSED:
                    raise
                continue
            if sender == network.card and answered == code:
                return status
        raise TimeoutError(
            f"the card at {network.card}, port {network.command_port}, did not answer "
            f"{code.name} within {self.timeout_s:g} s: is it powered and on the cable, "
            f"and does that interface of this machine have the address {network.host}? "
            "See `ip addr` and jradar/stream/README.md"
        )
