"""The WebSocket server: what Foxglove's own server says, for local pages alone."""

import contextlib
import json
import socket
import struct
import threading
import time
import types

import pytest

from tests.outputs.scenes import frame_of
from tests.stream.loops import PATIENCE_S, wait_until

pytest.importorskip("foxglove")
client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")

from jradar.stream.server import BACKLOG, Server  # noqa: E402  (needs the packages)

VIEW = frame_of(1)
TOPICS = {
    "/radar/points": "foxglove.PointCloud",
    "/enhanced/points": "foxglove.PointCloud",
    "/lidar/points": "foxglove.PointCloud",
    "/radar/range_azimuth": "foxglove.RawImage",
    "/tf": "foxglove.FrameTransforms",
}


@pytest.fixture
def server():
    with contextlib.closing(Server(port=0)) as made:
        yield made


def connected(port, **options):
    options = {"subprotocols": ["foxglove.sdk.v1"], "max_size": None} | options
    return client.connect(f"ws://127.0.0.1:{port}", **options)


def told(socket):
    return json.loads(socket.recv(PATIENCE_S))


def advertised(socket):
    """The channels that a server advertises, by topic."""
    assert told(socket)["op"] == "serverInfo"
    channels = told(socket)
    assert channels["op"] == "advertise"
    return {channel.pop("topic"): channel for channel in channels["channels"]}


def ask(socket, op, **fields):
    socket.send(json.dumps({"op": op, **fields}))


def subscribe(server, socket, ids):
    """Subscribe to channels by their ids, and wait until the server has heard it."""
    wanted = [{"id": 100 + i, "channelId": i} for i in ids]
    ask(socket, "subscribe", subscriptions=wanted)
    wait_until(lambda: len(server._viewers[0].subscriptions) == len(ids), "it")


def messages(socket, count):
    """Messages of a subscription, by its number: time and bytes."""
    found = {}
    while len(found) < count:
        raw = socket.recv(PATIENCE_S)
        opcode, subscription, time_ns = struct.unpack_from("<BIQ", raw)
        assert opcode == 1
        found[subscription] = time_ns, raw[13:]
    return found


def test_topics_are_there_before_the_first_frame_and_without_a_lidar(server):
    with connected(server.port) as socket:
        channels = advertised(socket)
        assert {t: c["schemaName"] for t, c in channels.items()} == TOPICS
        subscribe(server, socket, [channel["id"] for channel in channels.values()])
        without = {"radar": VIEW.clouds["radar"]}
        server.write(VIEW._replace(clouds=without, picture=None))
        found = messages(socket, 2)
    ids = {100 + channels[topic]["id"] for topic in ("/radar/points", "/tf")}
    assert found.keys() == ids
    assert {time_ns for time_ns, _ in found.values()} == {VIEW.stamp_ns}


def test_channels_and_messages_are_those_of_foxgloves_own_server(server):
    import foxglove
    from foxglove.channels import PointCloudChannel

    from jradar.outputs.foxglove import FoxgloveMessages

    context = foxglove.Context()
    theirs = foxglove.start_server(port=0, context=context)
    channel = PointCloudChannel("/radar/points", context=context)
    message = dict(FoxgloveMessages("test").of(VIEW))["/radar/points"]

    def said(port, publish):
        with connected(port) as socket:
            found = advertised(socket)["/radar/points"]
            wanted = [{"id": 7, "channelId": found.pop("id")}]
            ask(socket, "subscribe", subscriptions=wanted)
            ask(socket, "nonsense")
            assert told(socket)["op"] == "status"
            publish()
            return found, socket.recv(PATIENCE_S)

    try:
        expected = said(
            theirs.port, lambda: channel.log(message, log_time=VIEW.stamp_ns)
        )
    finally:
        theirs.stop()
    assert said(server.port, lambda: server.write(VIEW)) == expected


ALLOWED = "https://viewer.example.org"
SERVED = [None, "https://app.foxglove.dev", "http://localhost:8080", "http://127.0.0.1"]
SERVED += ["http://[::1]:5173", "file://", ALLOWED]  # None: a program on the desktop
REFUSED = ["https://evil.example", "null", "https://app.foxglove.dev.evil.example"]
REFUSED += ["http://app.foxglove.dev", "http://localhost.evil.example"]
REFUSED += ["http://127.0.0.1.evil.example", "http://evil.example/http://localhost"]


@pytest.mark.parametrize("origin", SERVED + REFUSED)
def test_pages_of_others_are_refused(origin):
    said = []
    made = Server(port=0, allow_origins=[f"{ALLOWED}/"], say=said.append)
    with contextlib.closing(made) as server:
        if origin in SERVED:
            with connected(server.port, origin=origin) as socket:
                assert advertised(socket).keys() == TOPICS.keys()
            return
        for _ in range(2):
            with pytest.raises(exceptions.InvalidStatus, match="HTTP 403"):
                connected(server.port, origin=origin)
        assert len(said) == 1 and f"{origin!r} asked" in said[0]
        assert "--allow-origin" in said[0] and not server._viewers


SUBSCRIBE = '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": %s}]}'


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("{", "not understood"),
        ("[]", "not understood"),
        (b"\xff\x00", "not understood"),
        ("[" * 100_000, "not understood"),
        ('{"op": "subscribe"}', "not understood"),
        ('{"op": "subscribe", "subscriptions": [{"id": -1}]}', "not understood"),
        (SUBSCRIBE % "99", "no channel 99"),
        (SUBSCRIBE % "[]", "not understood"),
        ('{"op": "advertise"}', "only publishes: 'advertise'"),
    ],
)
def test_a_viewer_that_asks_nonsense_is_answered_and_served(server, message, answer):
    with connected(server.port) as socket:
        channel = advertised(socket)["/tf"]["id"]
        socket.send(message)
        status = told(socket)
        assert status["op"] == "status" and answer in status["message"]
        subscribe(server, socket, [channel])
        server.write(VIEW)
        assert messages(socket, 1)


def test_what_is_unsubscribed_from_is_not_sent(server):
    with connected(server.port) as socket:
        channels = advertised(socket)
        subscribe(server, socket, [channels[t]["id"] for t in ("/radar/points", "/tf")])
        gone, kept = (100 + channels[t]["id"] for t in ("/radar/points", "/tf"))
        ask(socket, "unsubscribe", subscriptionIds=[gone])
        wait_until(lambda: len(server._viewers[0].subscriptions) == 1, "it")
        server.write(VIEW)
        assert messages(socket, 1).keys() == {kept}


@pytest.mark.slow
def test_a_viewer_that_does_not_read_holds_up_nobody(server):
    """It misses the oldest messages; memory does not grow."""
    with contextlib.ExitStack() as sockets:
        slow = connected(server.port, max_queue=1, close_timeout=0.1)
        sockets.enter_context(slow)
        channel = advertised(slow)["/radar/points"]["id"]
        subscribe(server, slow, [channel])  # so it is the server's first viewer
        advertised(sockets.enter_context(connected(server.port)))
        frame, begin = frame_of(0, points=50_000), time.monotonic()  # a megabyte
        for _ in range(60):
            server.write(frame)
        assert time.monotonic() - begin < PATIENCE_S / 2
        assert len(server._viewers[0]._waiting) <= BACKLOG


def test_viewers_that_never_answer_delay_the_end_by_two_seconds_together():
    server = Server(port=0)
    with contextlib.ExitStack() as sockets:
        for _ in range(20):
            made = connected(server.port, max_queue=1, close_timeout=0.1)
            viewer = sockets.enter_context(made)
            ids = [channel["id"] for channel in advertised(viewer).values()]
            wanted = [{"id": 100 + i, "channelId": i} for i in ids]
            ask(viewer, "subscribe", subscriptions=wanted)
        address = "127.0.0.1", server.port
        silent = sockets.enter_context(socket.create_connection(address))
        seen = lambda: sum(bool(v.subscriptions) for v in server._viewers)  # noqa: E731
        wait_until(lambda: seen() == 20, "20 viewers")
        for _ in range(BACKLOG):
            server.write(frame_of(0, points=100_000))
        ending, begin = threading.Thread(target=server.close, daemon=True), time.time()
        ending.start()
        ending.join(PATIENCE_S)
        assert time.time() - begin < 4.0
        silent.settimeout(PATIENCE_S)
        assert silent.recv(1) == b""
        wait_until(lambda: not server._viewers, "the last thread of a viewer")


def test_files_are_closed_before_the_server(monkeypatch):
    from jradar.cli.options import parser
    from jradar.cli.streaming import open_writers
    from jradar.outputs import writers

    closed, close = [], Server.close
    output = types.SimpleNamespace(close=lambda: closed.append("output"))
    monkeypatch.setattr(writers, "open_writer", lambda *_, **options: output)
    monkeypatch.setattr(Server, "close", lambda s: [closed.append("server"), close(s)])
    with contextlib.ExitStack() as stack:
        options = parser().parse_args(["live", "--serve", "0", "-o", "walk.mcap"])
        open_writers(options, stack)
    assert closed == ["output", "server"]


def test_a_taken_port_is_named_and_the_end_closes_the_connections():
    server = Server(port=0)
    with pytest.raises(OSError, match="Name another with --serve PORT"):
        Server(port=server.port)
    with connected(server.port) as socket:
        advertised(socket)
        server.close()
        with pytest.raises(exceptions.ConnectionClosed):
            socket.recv(PATIENCE_S)
    with pytest.raises(OSError):
        connected(server.port)


def test_the_option_adds_an_origin():
    from jradar.cli.options import parser
    from jradar.cli.streaming import open_writers

    command = "live --serve 0 --allow-origin https://a.example --allow-origin"
    options = parser().parse_args([*command.split(), "https://b.example"])
    with contextlib.ExitStack() as stack:
        (server,) = open_writers(options, stack)
        for origin in ("https://a.example", "https://b.example"):
            with connected(server.port, origin=origin) as socket:
                advertised(socket)
