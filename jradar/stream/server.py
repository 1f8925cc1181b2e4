"""A WebSocket server that Foxglove connects to.

Any web page in a browser can connect to a server on the same machine. Browsers say in
the header Origin where a page comes from. Pages of this machine and of Foxglove are
served, and so are programs outside a browser, which send no Origin. Other pages are
refused.

    serverInfo, advertise    topics with their schemas, once a viewer connects
    subscribe, unsubscribe   what it wants to see
    1 | id u32 | time u64 | message     for each frame, little-endian

(Foxglove's WebSocket protocol, version 1. The server of foxglove-sdk cannot check the
Origin.)
"""

import base64
import contextlib
import json
import logging
import re
import socket
import struct
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from jradar.errors import optional
from jradar.outputs.foxglove import ENCODING, FoxgloveMessages
from jradar.outputs.published import Published

DEFAULT_PORT = 8765
BACKLOG = 16  # messages that wait for a slow viewer, some megabytes each
PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
FOXGLOVE = "https://app.foxglove.dev"
LOCAL = re.compile(r"file://|https?://(localhost|127\.\d+\.\d+\.\d+|\[::1\])(:\d+)?")
HEAD = struct.Struct("<BIQ")  # opcode, subscription, time in ns
WARNING = 1  # level of a status
MOST_NAMED = 10  # pages that are named when they are refused
CLOSING_S = 1.0  # in which viewers may answer the end; as long again to cut them off
WAKE_S = 0.02  # between two looks at what has ended


class Viewer:
    """One connection: what it subscribed to, and the messages that wait for it."""

    def __init__(self, connection: Any):
        self.connection = connection
        self.subscriptions: dict[int, int] = {}  # by channel
        self._waiting: deque[str | bytes] = deque(maxlen=BACKLOG)
        self._news, self._ended = threading.Condition(), False

    def publish(self, channel: int, time_ns: int, message: bytes) -> None:
        """Queue a message, if the viewer has subscribed to its channel."""
        subscription = self.subscriptions.get(channel)
        if subscription is not None:
            self.put(HEAD.pack(1, subscription, time_ns) + message)

    def put(self, message: str | bytes) -> None:
        """Queue a message; drop the oldest if too many wait."""
        with self._news:
            self._waiting.append(message)
            self._news.notify()

    def send_all(self, closed: type[Exception]) -> None:
        """Send what waits, until the end of the connection."""
        with contextlib.suppress(closed):
            while True:
                with self._news:
                    self._news.wait_for(lambda: self._waiting or self._ended)
                    if self._ended:
                        return
                    message = self._waiting.popleft()
                self.connection.send(message)

    def end(self) -> None:
        """Let `send_all` return."""
        with self._news:
            self._ended = True
            self._news.notify()


class Server:
    """Serves frames to every viewer that connects."""

    def __init__(
        self,
        *,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        allow_origins: Sequence[str] = (),
        say: Callable[[str], None] = lambda line: None,
    ):
        """Start serving; port 0 takes a free one. OSError if the port is taken.

        `allow_origins` are served in addition to the local ones and Foxglove's. Pages
        of other origins are refused, and `say` is called with a line about each origin.
        """
        self._messages = FoxgloveMessages("--serve")
        need = "--serve needs websockets"
        websockets = optional("websockets", need=need, extra="live")
        serving = optional("websockets.sync.server", need=need, extra="live")
        self._closed = websockets.ConnectionClosed
        self._allowed = {FOXGLOVE, *(origin.rstrip("/") for origin in allow_origins)}
        self._say, self._refused = say, set[str]()
        self._viewers: list[Viewer] = []
        self._connections = weakref.WeakSet[Any]()  # also those without a handshake
        self._made = serving.ServerConnection
        self._lock = threading.Lock()
        self._channels: dict[str, dict[str, Any]] = {}
        for topic, kind in self._messages.kinds().items():
            self._advertised(topic, kind)
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        quiet = logging.getLogger(__name__)  # on broken handshakes and the like
        quiet.addHandler(logging.NullHandler())
        try:
            bound = socket.create_server((host, port), family=family)
        except OSError as error:
            raise OSError(
                f"port {port} of {host} cannot be opened ({error}): is another "
                "program using it? Name another with --serve PORT"
            ) from error
        self.host, self.port = host, bound.getsockname()[1]
        self._server = serving.serve(
            self._serve,
            sock=bound,
            subprotocols=PROTOCOLS,
            process_request=self._refusal,
            create_connection=self._connection,
            compression=None,
            close_timeout=CLOSING_S,
            logger=quiet,
        )
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def write(self, frame: Published) -> None:
        """Send a frame to all viewers; those that are too slow miss it."""
        with self._lock:
            viewers = [*self._viewers]
        if not viewers:
            return
        for topic, message in self._messages.of(frame):
            channel = self._advertised(topic, type(message))
            raw = message.encode()
            for viewer in viewers:
                viewer.publish(channel["id"], frame.stamp_ns, raw)

    def save(self) -> None:
        """Do nothing: no frame is kept."""

    def close(self) -> None:
        """Stop serving, within two seconds whatever the viewers do."""
        with self._lock:
            viewers, connections = [*self._viewers], [*self._connections]
        for viewer in viewers:
            viewer.end()
        ends = [self._server.shutdown, *(one.close for one in connections)]
        threads = [threading.Thread(target=end, daemon=True) for end in ends]
        for thread in threads:
            thread.start()
        begin = time.monotonic()
        while any(thread.is_alive() for thread in threads):
            if (waited := time.monotonic() - begin) > 2 * CLOSING_S:
                break
            if waited > CLOSING_S:
                self._cut_off()
            time.sleep(WAKE_S)

    def _cut_off(self) -> None:
        """End all connections, also one that is sending to a viewer who never reads."""
        with self._lock:
            connections = [*self._connections]
        for connection in connections:
            with contextlib.suppress(OSError):  # it has ended
                connection.socket.shutdown(socket.SHUT_RDWR)

    def _connection(self, *arguments: Any, **options: Any) -> Any:
        """Return a new connection, which `close` will find."""
        connection = self._made(*arguments, **options)
        with self._lock:
            self._connections.add(connection)
        return connection

    def _advertised(self, topic: str, kind: Any) -> dict[str, Any]:
        """Return the channel of a topic; announce a new one to all viewers."""
        if topic in self._channels:
            return self._channels[topic]
        schema = kind.get_schema()
        with self._lock:
            channel = self._channels[topic] = {
                "id": len(self._channels) + 1,
                "topic": topic,
                "encoding": ENCODING,
                "schemaName": schema.name,
                "schemaEncoding": schema.encoding,
                "schema": base64.b64encode(schema.data).decode(),
            }
            for viewer in self._viewers:
                viewer.put(_text("advertise", channels=[channel]))
        return channel

    def _refusal(self, connection: Any, request: Any) -> Any:
        """Return the answer to a page that is not served, else None."""
        origin = request.headers.get("Origin")
        if origin is None or origin in self._allowed or LOCAL.fullmatch(origin):
            return None
        if origin not in self._refused and len(self._refused) < MOST_NAMED:
            self._refused.add(origin)
            self._say(
                f"a web page of {origin!r} asked for the clouds and was refused: "
                "to serve it, name its address with --allow-origin"
            )
        return connection.respond(403, f"not served to {origin}: see --allow-origin\n")

    def _serve(self, connection: Any) -> None:
        """Serve one viewer until it leaves."""
        viewer = Viewer(connection)
        sending = threading.Thread(target=viewer.send_all, args=(self._closed,))
        viewer.put(_text("serverInfo", name="jradar", capabilities=[]))
        with self._lock:
            viewer.put(_text("advertise", channels=[*self._channels.values()]))
            self._viewers.append(viewer)
        sending.start()
        with contextlib.suppress(self._closed):
            for message in connection:
                if why := self._obey(viewer, message):
                    viewer.put(_text("status", level=WARNING, message=why))
        with self._lock:
            self._viewers.remove(viewer)
        viewer.end()
        sending.join()

    def _obey(self, viewer: Viewer, message: str | bytes) -> str:
        """Do what a viewer asks for; return why not, else ""."""
        try:
            asked = json.loads(message)
            if asked["op"] == "subscribe":
                known = {channel["id"] for channel in self._channels.values()}
                for each in asked["subscriptions"]:
                    HEAD.pack(1, each["id"], 0)
                    if each["channelId"] not in known:
                        return f"there is no channel {each['channelId']!r}"
                    viewer.subscriptions[each["channelId"]] = each["id"]
            elif asked["op"] == "unsubscribe":
                kept = viewer.subscriptions.items()
                gone = {*asked["subscriptionIds"]}
                viewer.subscriptions = {c: i for c, i in kept if i not in gone}
            else:
                return f"jradar only publishes: {asked['op']!r} is not supported"
        except (ValueError, TypeError, KeyError, RecursionError, struct.error) as error:
            return f"the message is not understood: {error!r}"
        return ""


def _text(op: str, **fields: Any) -> str:
    return json.dumps({"op": op, **fields})
