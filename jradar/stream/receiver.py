"""Receives a card's packets, and hands over the newest frame of samples.

The thread takes all packets that wait in one system call, and copies their samples into
buffers that are used again.
"""

import socket
import time
from typing import Any

from jradar.stream.assembler import Assembler, Counts
from jradar.stream.protocol import MOST_PACKET, NetworkSpec
from jradar.stream.sockets import address_bytes, batch_reader, udp_socket
from jradar.stream.source import WAKE_S, ReceivedFrame, Source

FRAMES_IN_SOCKET = 2
MANY = 100  # packets; so many are not an accident
LEAST_BUFFER, MOST_BUFFER = 1 << 20, 1 << 30  # bytes of the socket's buffer


class Receiver(Source):
    """Frames of the card in `network`; a `with` block starts and ends the thread."""

    def __init__(self, frame_bytes: int, network: NetworkSpec, *, waiting: int = 1):
        """Bind the data port; OSError if it is taken.

        At most `waiting` frames wait to be taken.
        """
        super().__init__(waiting)
        self.network = network
        self.foreign_sender = ""  # of the last packet that is not the card's
        self._assembler = Assembler(frame_bytes, self._deliver)
        self._socket = udp_socket(network.host, network.data_port, timeout_s=WAKE_S)
        self.port: int = self._socket.getsockname()[1]  # a free one if 0 was asked for
        asked = FRAMES_IN_SOCKET * frame_bytes
        size = min(max(asked, LEAST_BUFFER), MOST_BUFFER)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        granted = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
        if granted < asked:
            self.note = (
                f"the system keeps {granted:,} bytes of packets, but two frames have "
                f"{asked:,}: `sudo sysctl -w net.core.rmem_max={asked}` prevents losses"
            )

    @property
    def counts(self) -> Counts:
        """What happened to packets and frames so far."""
        return self._assembler.counts

    @property
    def heard(self) -> bool:
        """Whether packets of the stream have come."""
        return self.counts.placed > 0

    def close(self) -> None:
        """End the thread, deliver the frames that have passed, and free the port."""
        listened = self._thread.is_alive()
        super().close()
        if listened:
            self._assembler.flush()
        self._socket.close()

    def recycle(self, frame: ReceivedFrame) -> None:
        """Give back the buffer of a frame that was taken."""
        self._assembler.recycle(frame.data)

    def silence(self, limit_s: float) -> str:
        """Return why nothing may have come from the card for `limit_s`, else ""."""
        silent = time.monotonic() - self.heard_s
        if silent < limit_s:
            return ""
        network, counts = self.network, self.counts
        text = (
            f"no packets from the card {network.card} on port {self.port} of "
            f"{network.host} for {silent:.1f} s: "
        )
        if counts.foreign:
            return text + (
                f"{counts.foreign:,} came from others, the last from "
                f"{self.foreign_sender}: is that the card? Name it with --card"
            )
        return text + (
            "was the board started (sensorStart), does its .cfg switch the stream on "
            "(lvdsStreamCfg -1 0 1 0), and does the firewall let the port through? See "
            "jradar/stream/README.md"
        )

    def losses(self) -> str:
        """Return the number of packets that were lost."""
        return f"{self.counts.lost_packets} packets lost"

    def describe(self) -> dict[str, Any]:
        """Return what happened to frames and packets."""
        counts = self.counts
        return {
            "frames with losses": counts.damaged,
            "frames mostly lost": counts.sparse,
            "frames missing": counts.missing,
            "packets": {
                "received": counts.packets,
                "lost": counts.lost_packets,
                "repeated": counts.repeated,
                "late": counts.late,
                "not of the stream": counts.ignored,
                "malformed": counts.malformed,
                "of other senders": counts.foreign,
            },
            "restarts of the card": counts.restarts,
        }

    def oddity(self) -> str:
        """Return a warning if many packets do not belong to the stream, else ""."""
        counts, found = self.counts, []
        if counts.foreign >= MANY:
            found.append(
                f"{counts.foreign:,} packets from other senders, the last from "
                f"{self.foreign_sender}: another card or program sends to port "
                f"{self.port}"
            )
        if counts.malformed >= MANY:
            found.append(
                f"{counts.malformed:,} packets without a header or longer than "
                f"{MOST_PACKET:,} bytes: is dataLoggingMode raw?"
            )
        if counts.ignored >= MANY:
            found.append(
                f"{counts.ignored:,} packets from {self.network.card} whose counters "
                "do not continue its stream: do two cards have this address? Switch "
                "one off, or give it another address"
            )
        if found:
            return "; ".join([*found, "they are ignored"])
        if counts.repeated >= MANY and 2 * counts.repeated > counts.placed:
            return (
                f"{counts.repeated:,} packets from {self.network.card} came twice: do "
                "two cards have this address? Their frames are mixed: switch one off"
            )
        return ""

    def _listen(self) -> None:
        read, add = batch_reader(self._socket), self._assembler.add_all
        card, counts = address_bytes(self.network.card), self.counts
        while not self._ending.is_set():
            if (batch := read()) is None:
                continue
            own = (batch.senders == card).all(-1)
            if own.all():
                self.heard_s = time.monotonic()
                add(batch.data, batch.sizes)
                continue
            foreign = batch.senders[~own]
            counts.packets += len(foreign)
            counts.foreign += len(foreign)
            self.foreign_sender = socket.inet_ntoa(foreign[-1].tobytes())
            if own.any():
                self.heard_s = time.monotonic()
                add(batch.data[own], batch.sizes[own])
