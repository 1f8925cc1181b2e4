"""A thread that receives a card's packets, and hands over the newest frame.

The thread does nothing else. It takes all packets that wait in one system call, and
copies their samples into buffers that are used again. Whoever takes frames too slowly
gets the newest one; those it missed are counted in `dropped`.
"""

import socket
import threading
import time
from collections import deque

from jradar.stream.assembler import Assembler, Counts, ReceivedFrame
from jradar.stream.protocol import MOST_PACKET, NetworkSpec
from jradar.stream.sockets import address_bytes, batch_reader, udp_socket

WAKE_S = 0.1  # after which the thread checks whether it should end
FRAMES_IN_SOCKET = 2
MANY = 100  # packets; so many are not an accident
LEAST_BUFFER, MOST_BUFFER = 1 << 20, 1 << 30  # bytes of the socket's buffer


class Receiver:
    """Frames of the card in `network`; a `with` block starts and ends the thread."""

    def __init__(self, frame_bytes: int, network: NetworkSpec, *, waiting: int = 1):
        """Bind the data port; OSError if it is taken.

        At most `waiting` frames wait to be taken.
        """
        self.network, self.dropped = network, 0
        self.foreign_sender = ""  # of the last packet that is not the card's
        self._assembler = Assembler(frame_bytes, self._deliver)
        self._frames: deque[ReceivedFrame] = deque()
        self._waiting = waiting
        self._arrived = threading.Condition()
        self._ending = threading.Event()
        self._fault: Exception | None = None
        self.heard_s = time.monotonic()  # of the card, on the monotonic clock
        self._socket = udp_socket(network.host, network.data_port, timeout_s=WAKE_S)
        self.port: int = self._socket.getsockname()[1]  # a free one if 0 was asked for
        asked = FRAMES_IN_SOCKET * frame_bytes
        size = min(max(asked, LEAST_BUFFER), MOST_BUFFER)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, size)
        granted = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
        self.note = ""  # about the socket's buffer, if it is too small
        if granted < asked:
            self.note = (
                f"the system keeps {granted:,} bytes of packets, but two frames have "
                f"{asked:,}: `sudo sysctl -w net.core.rmem_max={asked}` prevents losses"
            )
        self._thread = threading.Thread(target=self._receive, daemon=True)

    @property
    def counts(self) -> Counts:
        """What happened to packets and frames so far."""
        return self._assembler.counts

    def __enter__(self) -> "Receiver":
        self.heard_s = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """End the thread, deliver the frames that have passed, and free the port."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
            self._assembler.flush()
        self._socket.close()

    def take(self, timeout_s: float) -> ReceivedFrame | None:
        """Return the oldest frame that waits, or None if none comes in time.

        Raises the error that ended the thread, if one did.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._frames or self._fault, timeout_s)
            if self._frames:
                return self._frames.popleft()
        if self._fault is not None:
            raise self._fault
        return None

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

    def strangers(self) -> str:
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

    def _receive(self) -> None:
        """Receive until the end; `take` raises an error that ends it early."""
        try:
            self._loop()
        except Exception as error:
            with self._arrived:
                self._fault = error
                self._arrived.notify_all()

    def _loop(self) -> None:
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

    def _deliver(self, frame: ReceivedFrame) -> None:
        with self._arrived:
            while len(self._frames) >= self._waiting:
                self.recycle(self._frames.popleft())
                self.dropped += 1
            self._frames.append(frame)
            self._arrived.notify()
