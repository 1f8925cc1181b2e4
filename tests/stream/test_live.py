"""The live loop: the library's clouds, frames that add up, silence explained."""

import itertools
import logging
import os
import signal
import threading
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from jradar.radar import PointSpec, Radar, RadarSpec, Scatterers, radar_points
from jradar.radar.simulate import simulate_cube
from jradar.recordings import Recording, Stream
from jradar.stream.emulator import recorded_frames
from jradar.stream.live import (
    FrameRate,
    StatusLine,
    ended_by_signals,
    run_live,
    summary,
)
from jradar.stream.processing import Processor, frame_bytes, radar_on_the_cable
from jradar.stream.receiver import Receiver
from jradar.stream.sockets import loopback_network, udp_socket
from tests.recordings.lua_writer import FOUR_LANES, script
from tests.recordings.ti.test_dca1000 import CFG
from tests.stream.loops import PATIENCE_S, RACES, deliver, loop, wait_until

pytestmark = RACES
RADAR = RadarSpec.awr1843(num_chirps=4, num_samples=32)  # 6,144 bytes a frame
POINTS = PointSpec(capacity=32, false_alarm_rate=0.05, guard=(0, 1), train=(1, 4))


def echoes(count):
    """Cubes of one echo that recedes from frame to frame, as whole numbers."""
    keys = jax.random.split(jax.random.key(0), count)
    for number, key in enumerate(keys):
        xyz = np.array([[1.0 + 0.1 * number, 0.3, 0.1]], np.float32)
        echo = Scatterers(xyz, np.zeros(1, np.float32), np.full(1, 500, np.float32))
        yield np.rint(np.asarray(simulate_cube(key, echo, RADAR, noise_power=100.0)))


CUBES = [*echoes(6)]
FRAME_CUBES = Stream(CUBES.__getitem__, len(CUBES))
RECORDING = Recording("test", "test.bin", Radar(RADAR), FRAME_CUBES)
FRAMES = recorded_frames(RECORDING)


class Kept:
    """A writer that keeps what it gets."""

    def __init__(self, act=lambda frame: None):
        self.frames, self.act, self.saved = [], act, 0

    def write(self, frame):
        """Act, and keep the frame."""
        self.act(frame)
        self.frames.append(frame)

    def save(self):
        """Count how often there was time."""
        self.saved += 1

    def close(self):
        """Nothing is left to do."""


@pytest.fixture(scope="module")
def processor():
    made = Processor(RECORDING, points=POINTS)
    made.warm_up()
    return made


def arrived(receiver):
    return receiver.counts.frames >= len(CUBES)


def play(processor, writer, **options):
    with loop(FRAMES, **options) as (emulator, receiver):
        emulator.start()

        def finished():
            return emulator.finished.is_set() and arrived(receiver)

        options = {"silence_s": PATIENCE_S, "finished": finished}
        session = run_live(receiver, processor, [writer], **options)
    return session, receiver


def test_published_clouds_are_the_librarys(processor):
    kept = Kept()
    session, receiver = play(processor, kept)
    assert session.published == len(kept.frames) == len(CUBES)
    assert session.latency_ms(50) <= session.latency_ms(95)
    for frame, cube in zip(kept.frames, CUBES, strict=True):
        expected = radar_points(cube, Radar(RADAR), points=POINTS.fitted(RADAR))
        np.testing.assert_array_equal(frame.clouds["radar"].xyz, expected.xyz)
        assert frame.clouds["radar"].valid.any()
        assert frame.picture.shape == (32, 64) and frame.picture.max() == 255
    told = summary(session, receiver)
    assert told["frames received"] == told["frames published"] == len(CUBES)
    assert told["packets"]["lost"] == 0


def test_frames_in_are_frames_out_and_those_dropped(processor):
    """A writer that waits until the next frames have arrived."""
    go_on = threading.Event()
    slow = Kept(lambda frame: go_on.wait(0.5))
    session, receiver = play(processor, slow, waiting=1)
    told = summary(session, receiver)
    assert told["frames received"] == len(CUBES)
    assert told["frames received"] == told["frames published"] + told["frames dropped"]
    assert len(slow.frames) == told["frames published"]
    assert slow.frames[-1].number == len(CUBES) - 1


def test_a_card_that_never_sends_is_explained(processor):
    with Receiver(frame_bytes(RECORDING), loopback_network()) as receiver:
        with pytest.raises(TimeoutError, match="no packets from the card 127.0.0.2"):
            run_live(receiver, processor, [], silence_s=0.3)


def test_a_card_that_falls_silent_is_reported_once(processor):
    said, silent_turns, kept = [], itertools.count(), Kept()
    with loop(FRAMES) as (emulator, receiver):
        emulator.start()
        wait_until(lambda: receiver.counts.placed, "packets")

        def finished():
            return bool(said) and next(silent_turns) > 4

        options = {"silence_s": 0.3, "say": said.append, "finished": finished}
        run_live(receiver, processor, [kept], **options)
    assert len(said) == 1 and "no packets from the card" in said[0]
    assert kept.saved > 4  # meanwhile, what was written becomes safe


def test_packets_of_others_are_reported_once_while_frames_go_on(processor):
    said = []
    with (
        loop(FRAMES) as (emulator, receiver),
        udp_socket("127.0.0.3", 0, timeout_s=1.0) as stranger,
    ):
        deliver(stranger, receiver, [b"x" * 500] * 150)
        emulator.start()
        options = {"silence_s": PATIENCE_S, "say": said.append}
        options |= {"finished": lambda: arrived(receiver)}
        session = run_live(receiver, processor, [], **options)
    assert session.published == len(CUBES)
    assert len(said) == 1 and "150 packets from other senders" in said[0]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_loop_after_the_frame(processor, number):
    kept = Kept(lambda frame: os.kill(os.getpid(), number))
    before = signal.getsignal(number)
    session, _ = play(processor, kept)
    assert session.published == len(kept.frames) == 1
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("level", [logging.WARNING, logging.ERROR])
def test_the_status_line_is_silent_where_errors_alone_are_asked_for(level, capsys):
    session = SimpleNamespace(published=3, frames_per_s=10.0, latency_ms=lambda _: 5.0)
    source = SimpleNamespace(losses=lambda: "no bytes lost", dropped=0)
    logger = logging.getLogger("jradar")
    before = logger.level
    logger.setLevel(level)
    try:
        StatusLine().show(session, source)
    finally:
        logger.setLevel(before)
    shown = "3 frames, 10.0 frames/s" in capsys.readouterr().err
    assert shown == (level == logging.WARNING)


def test_the_second_signal_acts_as_usual():
    # Programs in the background of a shell start with SIGINT ignored.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with ended_by_signals() as ending:
            os.kill(os.getpid(), signal.SIGINT)
            assert ending.wait(PATIENCE_S)
            with pytest.raises(KeyboardInterrupt):
                os.kill(os.getpid(), signal.SIGINT)
                ending.clear()
                ending.wait(PATIENCE_S)
    finally:
        signal.signal(signal.SIGINT, before)


def test_frames_of_another_size_than_the_cfgs_are_warned_of(tmp_path):
    (tmp_path / "profile.cfg").write_text(CFG)  # a frame every 100 ms
    processor = Processor(radar_on_the_cable(tmp_path / "profile.cfg"), points=POINTS)
    for period, warned in ((0.1, False), (0.105, False), (0.05, True), (0.2, True)):
        rate = FrameRate(processor.recording)
        warnings = [rate.add(number, 7 + number * period) for number in range(200)]
        assert len([*filter(None, warnings)]) == warned
        if warned:
            said = "".join(warnings)
            assert f"comes every {1e3 * period:.4g} ms" in said
            assert f"{0.1 / period:.3g} times as large" in said


def test_headers_between_the_chirps_are_refused(tmp_path):
    (tmp_path / "profile.cfg").write_text(CFG + "lvdsStreamCfg -1 1 1 0\n")
    with pytest.raises(ValueError, match="puts headers between the chirps"):
        radar_on_the_cable(tmp_path / "profile.cfg")


def test_four_lanes_on_the_cable_are_named(tmp_path):
    path = tmp_path / "capture.lua"
    path.write_text(script(lanes=FOUR_LANES))
    [note] = radar_on_the_cable(path).notes
    assert "a card takes two" in note
    path.write_text(script())
    assert radar_on_the_cable(path).notes == ()
