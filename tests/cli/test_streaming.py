"""`jradar live`, `replay`, `enhance -o out.mcap`: clouds through the same writers."""

import argparse
import contextlib
import signal
import threading

import numpy as np
import pytest

from jradar.cli.streaming import open_writers
from jradar.model import save_model
from jradar.recordings import nearest_scan, open_recording
from jradar.stream.emulator import Emulator, recorded_frames
from jradar.stream.sockets import loopback_network
from tests.cli.conftest import QUICK
from tests.models import tiny_polar_model
from tests.outputs.readers import mcap_messages
from tests.programs import started
from tests.recordings.conftest import root as root, sequence as sequence
from tests.recordings.dca1000_writer import CFG, as_bytes, random_cubes
from tests.stream.loops import PATIENCE_S
from tests.stream.test_board import demo


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A small capture with its .cfg."""
    folder = tmp_path_factory.mktemp("capture")
    (folder / "profile.cfg").write_text(CFG)
    (folder / "adc_data.bin").write_bytes(as_bytes(random_cubes(4)))
    return folder / "adc_data.bin"


def words_of(network):
    """The options for these addresses."""
    options = {
        "--host": network.host,
        "--card": network.card,
        "--command-port": network.command_port,
        "--data-port": network.data_port,
    }
    return [word for pair in options.items() for word in pair]


def test_a_replay_becomes_an_mcap_file(sequence, run_json, tmp_path):
    pytest.importorskip("foxglove")
    out = tmp_path / "out.mcap"
    command = ["live", "--replay", sequence, "--model", "none", "-o", out]
    result = run_json(*command, "--speed", "0.5", "--silence", PATIENCE_S)
    published = result["frames_published"]
    assert published and published + result["frames_dropped"] == 12
    assert result["frames_received"] == 12 and result["packets"]["lost"] == 0
    assert result["written"] == [str(out)]
    messages = [*mcap_messages(out)]
    topics = [message.topic for message in messages]
    assert topics.count("/radar/points") == published
    (*_, last) = (m.content for m in messages if m.topic == "/lidar/points")
    scan = nearest_scan(open_recording(sequence), 11)
    np.testing.assert_allclose(last["x"], scan[:, 0], rtol=1e-6)


@pytest.mark.parametrize("name", ["walk", "walk.mcap"])
def test_an_emulated_radar_is_recorded(capture, run_json, tmp_path, name):
    pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
    out = tmp_path / name
    command = ["record", "--replay", capture, "-o", out, "--silence", PATIENCE_S]
    result = run_json(*command, "--speed", "0.5")
    assert result["frames_recorded"] == 4 and result["lost_bytes"] == 0
    recording, source = open_recording(out), open_recording(capture)
    np.testing.assert_array_equal([*recording.cubes], [*source.cubes])
    assert (np.diff(recording.cubes.stamps) > 0).all()
    told = run_json("info", out)
    assert told["frames"] == 4 and told["lost_bytes"] == 0 and "echoes" in told


def test_the_model_of_a_live_session_is_one_of_ones_own(
    small_cube, model_folder, run_json, tmp_path
):
    out = tmp_path / "out"
    command = ["live", "--replay", small_cube, "--model", model_folder, "-o", out]
    result = run_json(*command, "--silence", PATIENCE_S, "--seed", 3)
    assert result["frames_published"] == 1
    with np.load(out / "000000" / "enhanced.npz") as file:
        assert len(file["xyz"])


@pytest.mark.slow
def test_a_live_radar_with_one_row_is_told_what_it_does_not_measure(
    flat_cube, run_json, tmp_path
):
    model = tmp_path / "mine"
    save_model(model, tiny_polar_model())
    command = ["live", "--replay", flat_cube, "--model", model, "-o", tmp_path / "o"]
    result = run_json(*command, "--silence", PATIENCE_S)
    assert "height is not measured: all points lie at height 0" in result["notes"]
    with np.load(tmp_path / "o" / "000000" / "enhanced.npz") as file:
        assert len(file["xyz"]) and not file["xyz"][:, 2].any()


def test_a_server_says_what_to_open(caplog):
    pytest.importorskip("foxglove")
    pytest.importorskip("websockets")
    options = {"serve": 0, "serve_host": "127.0.0.1", "allow_origin": [], "output": ""}
    with contextlib.ExitStack() as stack:
        (server,) = open_writers(argparse.Namespace(**options), stack)
    assert "https://app.foxglove.dev" in caplog.text
    assert f"ws://127.0.0.1:{server.port}" in caplog.text


def test_enhanced_frames_become_one_file(
    sequence, model_folder, run_json, tmp_path, refused
):
    pytest.importorskip("foxglove")
    command = ["enhance", sequence, "--model", model_folder, *QUICK, "-o"]
    run_json(*command, tmp_path / "all.mcap")
    messages = [*mcap_messages(tmp_path / "all.mcap")]
    recording = open_recording(sequence)
    dense = [m for m in messages if m.topic == "/enhanced/points"]
    assert len(dense) == len(recording.cubes) > 1
    stamps = [round(stamp * 1e9) for stamp in recording.cubes.stamps]
    assert [message.time_ns for message in dense] == stamps
    topics = {message.topic for message in messages}
    assert {"/lidar/points", "/radar/range_azimuth", "/tf"} < topics
    verdicts = [m.content for m in messages if m.topic == "/enhanced/verdict"]
    assert len(verdicts) == len(dense) and "of its points may be right" in verdicts[0]
    run_json(*command, tmp_path / "folder", "--frame", 1)
    with np.load(tmp_path / "folder" / "enhanced.npz") as file:
        for name, column in zip("xyz", file["xyz"].T, strict=True):
            np.testing.assert_array_equal(dense[1].content[name], column)
    pytest.importorskip("rosbags")
    found = run_json("info", tmp_path / "all.mcap")
    assert {row["topic"]: row["messages"] for row in found["topics"]} == {
        topic: sum(m.topic == topic for m in messages) for topic in topics
    }
    run_json(*command, tmp_path / "few.ros2", "--frames", "0:2")
    topics = run_json("info", tmp_path / "few.ros2")["topics"]
    counts = {row["topic"]: row["messages"] for row in topics}
    assert counts["/enhanced/points"] == counts["/radar/points"] == 2


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["live"], 2, "--radar, such as the .cfg"),
        (["live", "--radar", "{cfg}", "--host", "192.0.2.1"], 3, "has no address"),
        (
            ["live", "--replay", "{bin}", "-o", "out.bag"],
            2,
            "of all frames: .mcap, .ros2",
        ),
        (["live", "--replay", "no.bin"], 2, "no such file"),
        (
            ["live", "--replay", "{flat}"],
            2,
            "--model radarhd` for a cloud",
        ),
        (["enhance", "{bin}", "-o", "a.mcap", "--flat"], 2, "a.mcap is one file"),
        (["enhance", "{bin}", "-o", "a", "--flat", "--picture"], 2, "leave out --fl"),
        (["replay", "{bin}", "--card", "192.0.2.1"], 3, "has no address 192.0.2.1"),
        (["replay", "{bin}", "--now", "--host", "198.51.100.1"], 3, "both --host and"),
    ],
)
def test_a_wrong_call_is_answered_in_one_line(
    arguments, code, message, capture, flat_cube, refused, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    names = {"bin": capture, "cfg": capture.with_name("profile.cfg"), "flat": flat_cube}
    words = [word.format(**names) for word in arguments]
    if words[0] == "live" and "{flat}" not in arguments:
        words += ["--model", "none"]
    assert message in refused(*words, code=code)


def test_card_and_board_are_set_up_and_stopped(capture, run_json, tmp_path):
    """An emulated card in a thread, a board behind a pseudo-terminal."""
    network, frames = loopback_network(), recorded_frames(open_recording(capture))
    cfg = capture.with_name("profile.cfg")
    with (
        demo() as (board, port),
        Emulator(frames, network, period_s=0.05, repeat=True) as emulator,
    ):
        command = ["live", "--radar", cfg, "--model", "none", "--board", port]
        command += ["--seconds", 2, "--silence", 60]
        result = run_json(*command, *words_of(network))
        sent = emulator.sent.packets
        assert sent and not emulator._sending.is_alive()
    received = result["packets"]["received"]
    assert received <= sent and result["frames_received"] > 0
    lines = [line for line in cfg.read_text().splitlines() if line]
    assert board.heard == [*lines, "sensorStart", "sensorStop"]


@pytest.mark.slow
def test_two_programs_talk_to_each_other(capture, tmp_path):
    """`replay` in one process, `live` in another, over the loopback; SIGINT ends it."""
    pytest.importorskip("foxglove")
    out, cfg = tmp_path / "out.mcap", str(capture.with_name("profile.cfg"))
    with contextlib.ExitStack() as stack:

        def begin(*words):
            process = started("jradar", *words, *addresses)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        addresses = words_of(loopback_network())
        playing = begin("replay", capture, "--repeat")
        assert "waits for START" in playing.stderr.readline()
        live = begin("live", "--radar", cfg, "--model", "none", "-o", out)
        killer = threading.Timer(2 * PATIENCE_S, live.kill)
        killer.start()
        told = ""
        while "frames/s" not in told and live.poll() is None:
            told = live.stderr.readline()
        live.send_signal(signal.SIGINT)
        output, errors = live.communicate()
        killer.cancel()
        assert live.returncode == 0, errors
        assert "frames published" in output and [*mcap_messages(out)]
        playing.send_signal(signal.SIGTERM)
        output, errors = playing.communicate(timeout=PATIENCE_S)
        assert playing.returncode == 0 and "frames sent" in output, errors
