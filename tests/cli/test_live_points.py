"""`jradar live` of a radar that sends points: a board, a port alone, a recording."""

import threading

import numpy as np
import pytest

from jradar.recordings import open_recording
from tests.recordings.points.test_ti_serial import CFG
from tests.recordings.points.ti_writer import packet
from tests.stream.loops import PATIENCE_S
from tests.stream.serial_line import line
from tests.stream.test_board import demo

# The ports are pseudo-terminals, and their other ends threads with timeouts.
pytestmark = pytest.mark.flaky(reruns=2, reruns_delay=5)
POINTS = [(0.5, 2.0, 0.1, -1.5)] * 5
FRAMES = 12
STREAM = [
    packet(number, POINTS, [30.0] * 5, cycles=number * 20_000_000)
    for number in range(FRAMES)
]


@pytest.fixture
def cfg(tmp_path):
    path = tmp_path / "profile.cfg"
    path.write_text(CFG + "configDataPort 921600 1\n")
    return path


@pytest.fixture
def saved(tmp_path):
    """The stream of twelve frames, 0.1 s apart, as a file."""
    path = tmp_path / "out.dat"
    path.write_bytes(b"".join(STREAM))
    return path


def sending(sender, *, pause_s=0.02, vanishing=False):
    """Send a stream from another thread, its first bytes torn off."""

    def send():
        for at, one in enumerate(STREAM):
            sender.send(one if at else one[40:], size=100)
            threading.Event().wait(pause_s)
        if vanishing:
            sender.vanish()

    thread = threading.Thread(target=send)
    thread.start()
    return thread


def clouds_of(folder):
    files = sorted(folder.glob("[0-9]*/radar.npz"))
    return [dict(np.load(file)) for file in files]


def test_a_board_is_started_its_points_are_published_and_it_is_stopped(
    cfg, run_json, tmp_path, monkeypatch
):
    threads, out = [], tmp_path / "out"
    with line() as sender:

        def answers(command):
            if command == "sensorStart":
                threads.append(sending(sender))
            return "Done"

        monkeypatch.setattr("jradar.stream.second_port", lambda port: sender.port)
        with demo(answers) as (board, port):
            command = ["live", "--board", port, "--points", "--radar", cfg]
            command += ["--device", "awr1642", "--model", "none", "-o", out]
            found = run_json(*command, "--seconds", 2, "--silence", PATIENCE_S)
        threads[0].join()
    lines = [text for text in cfg.read_text().splitlines() if text]
    assert board.heard == [*lines, "sensorStop"]
    assert found["port"] == sender.port and found["radar"] == "awr1642"
    assert found["frames_received"] == FRAMES - 1 and found["lost_bytes"] > 0
    assert found["frames_published"] + found["frames_dropped"] == FRAMES - 1
    clouds = clouds_of(out)
    assert len(clouds) == found["frames_published"] > 0
    np.testing.assert_allclose(clouds[-1]["xyz"], [(2.0, -0.5, 0.1)] * 5, rtol=1e-6)
    np.testing.assert_allclose(clouds[-1]["velocity"], -1.5)


def test_a_port_that_vanishes_ends_the_command_and_loses_nothing(refused, tmp_path):
    out = tmp_path / "out"
    with line() as sender:
        thread = sending(sender, pause_s=0.1, vanishing=True)
        command = ["live", "--points", sender.port, "--model", "none", "-o", out]
        said = refused(*command, "--silence", PATIENCE_S, code=3)
        thread.join()
    assert "is gone after" in said and "cable" in said
    assert len(clouds_of(out)) > FRAMES // 2


def test_a_recording_of_points_is_played_and_what_is_saved_is_one(
    saved, run_json, tmp_path
):
    pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
    out = tmp_path / "out.ros2"
    command = ["live", "--replay", saved, "--speed", 2, "--model", "none", "-o", out]
    found = run_json(*command, "--silence", PATIENCE_S)
    published = found["frames_published"]
    assert found["frames_received"] == FRAMES and "packets" not in found
    assert 0 < published == FRAMES - found["frames_dropped"]
    again, source = open_recording(out), open_recording(saved)
    assert len(again.points) == published
    for name in ("xyz", "velocity", "snr"):
        kept, sent = getattr(again.points[0], name), getattr(source.points[0], name)
        np.testing.assert_allclose(kept, sent, rtol=1e-5)


@pytest.mark.slow
def test_a_models_clouds_of_points_are_published(saved, run_json, tmp_path):
    out = tmp_path / "out"
    command = ["live", "--replay", saved, "--speed", 0.5, "-o", out]
    found = run_json(*command, "--silence", PATIENCE_S)
    assert len([*out.glob("*/enhanced.npz")]) == found["frames_published"] > 0
    assert any("that a radar sends" in note for note in found["notes"])


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["live", "--points"], 2, "--points: name the board's data port"),
        (["live", "--board", "COM3", "--points", "COM4"], 2, "with --radar"),
        (["live", "--points", "COM3", "--loss", "0.1"], 2, "--loss is for samples"),
        (["live", "--points", "COM3", "--card", "10.0.0.1"], 2, "--card is for sam"),
        (["live", "--replay", "{dat}", "--reorder", "2"], 2, "--reorder is for samp"),
        (["live", "--replay", "{dat}", "--points"], 2, "leave out --points"),
        (["live", "--replay", "{dat}", "--board", "COM3"], 2, "leave out --board"),
        (["live", "--points", "no/ttyACM1"], 3, "no/ttyACM1 cannot be opened"),
        (["record", "--replay", "{dat}", "-o", "x"], 2, "-o walk.ros2` saves points"),
        (["replay", "{dat}"], 2, "holds a radar's points"),
    ],
)
def test_a_wrong_call_is_answered_in_one_line(arguments, code, message, saved, refused):
    words = [word.format(dat=saved) for word in arguments]
    if words[0] == "live":
        words += ["--model", "none"]
    assert message in refused(*words, code=code)
