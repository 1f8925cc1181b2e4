"""The board's serial port: a pseudo-terminal that answers like the SDK's demo."""

import contextlib
import os
import select
import threading
import types

import pytest

from jradar.errors import UsageError
from jradar.stream.board import Board, second_port

# The port is a pseudo-terminal, and its other end a thread with timeouts.
pytestmark = pytest.mark.flaky(reruns=2, reruns_delay=5)

CFG = """\
% a comment

sensorStop
flushCfg
channelCfg 15 7 0   % all receivers
sensorStart
"""


class Demo:
    """The SDK's command line: it repeats a command, answers, and prints its prompt."""

    def __init__(self, master, answers):
        self.master, self.answers = master, answers
        self.heard, self.ending = [], threading.Event()

    def run(self):
        """Answer until the end."""
        line = b""
        while not self.ending.is_set():
            if not select.select([self.master], [], [], 0.05)[0]:
                continue
            line += os.read(self.master, 1)
            if line.endswith(b"\n"):
                command, line = line.decode().strip(), b""
                self.heard.append(command)
                answer = self.answers(command)
                if answer is not None:
                    told = f"{command}\n\r{answer}\n\rmmwDemo:/>"
                    os.write(self.master, told.encode())


@contextlib.contextmanager
def demo(answers=lambda command: "Done"):
    """A running demo, and the name of its port."""
    pytest.importorskip("serial")
    tty = pytest.importorskip("tty")
    master, slave = os.openpty()
    tty.setraw(slave)
    board = Demo(master, answers)
    thread = threading.Thread(target=board.run)
    thread.start()
    try:
        yield board, os.ttyname(slave)
    finally:
        board.ending.set()
        thread.join()
        os.close(master)
        os.close(slave)


@pytest.fixture
def cfg(tmp_path):
    path = tmp_path / "profile.cfg"
    path.write_text(CFG)
    return path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (CFG, ["sensorStop", "flushCfg", "channelCfg 15 7 0", "sensorStart"]),
        ("flushCfg\n", ["flushCfg", "sensorStart"]),  # completed
    ],
)
def test_every_command_is_sent_in_order(cfg, text, expected):
    cfg.write_text(text)
    with demo() as (heard, port), Board(port, timeout_s=60.0) as board:
        board.configure(cfg)
        board.stop()
    assert heard.heard == [*expected, "sensorStop"]


@pytest.mark.parametrize(
    "answer",
    [
        "Error -1",
        "'channelCfg' is not recognized as a CLI command",
        "Debug: Init Calibration Status = 0x7fe\n\rError: MMWave open failed",
    ],
)
def test_a_command_that_the_board_refuses_is_named_with_its_line(cfg, answer):
    def answers(command):
        return answer if command.startswith("channel") else "Done"

    with demo(answers) as (_, port), Board(port, timeout_s=60.0) as board:
        with pytest.raises(ValueError, match=r"line 5: 'channelCfg 15 7 0': the board"):
            board.configure(cfg)


def test_notes_of_the_board_are_no_errors(cfg):
    """The calibration at the start, and a stop that is ignored."""
    said = {
        "sensorStop": "Ignored: Sensor is already stopped\n\rDone",
        "sensorStart": "Debug: Init Calibration Status = 0x1ffe\n\rDone",
    }
    with (
        demo(lambda command: said.get(command, "Done")) as (_, port),
        Board(port, timeout_s=60.0) as board,
    ):
        board.configure(cfg)
        assert board.send("sensorStop").startswith("Ignored")


def test_a_board_without_an_answer_and_a_port_that_is_not_there_are_named(cfg):
    with demo(lambda _: None) as (_, port), Board(port, timeout_s=0.3) as board:
        with pytest.raises(TimeoutError, match=r"line 3: 'sensorStop': the board on"):
            board.configure(cfg)
    with pytest.raises(OSError, match=r"cannot be opened .* group dialout"):
        Board(str(cfg.with_name("ttyACM0")))


def usb_port(device, location, *, serial="R1"):
    """A port as pyserial lists it."""
    known = {"vid": 0x0451, "pid": 0xBEF3, "serial_number": serial}
    return types.SimpleNamespace(device=device, location=location, **known)


@pytest.mark.parametrize(
    ("board", "expected"),
    [
        ("/dev/ttyACM0", "/dev/ttyACM3"),  # its number was taken when it came
        ("/dev/ttyACM1", "/dev/ttyACM2"),
        ("COM8", "COM7"),  # Windows counts as it likes
        ("/dev/ttyUSB9", "/dev/ttyUSB10"),  # the second of three
        ("/dev/ttyS4", "/dev/ttyS5"),  # not on USB
        ("/dev/pts/9", "/dev/pts/10"),  # not listed
    ],
)
def test_the_data_port_is_the_other_one_of_the_board(monkeypatch, board, expected):
    list_ports = pytest.importorskip("serial.tools.list_ports")
    ports = [
        usb_port("/dev/ttyACM3", "1-4:1.3"),
        usb_port("/dev/ttyACM0", "1-4:1.0"),
        usb_port("/dev/ttyACM1", "1-5:1.0"),  # a second board of the same number
        usb_port("/dev/ttyACM2", "1-5:1.3"),
        usb_port("COM7", "1-1:x.3", serial="R2"),
        usb_port("COM8", "1-1:x.0", serial="R2"),
        usb_port("/dev/ttyUSB11", "1-6:1.2", serial=None),
        usb_port("/dev/ttyUSB9", "1-6:1.0", serial=None),
        usb_port("/dev/ttyUSB10", "1-6:1.1", serial=None),
        usb_port("/dev/ttyS4", None, serial=None),
        usb_port("/dev/ttyS7", None, serial=None),
    ]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert second_port(board) == expected


def test_a_link_to_a_port_is_followed(monkeypatch, tmp_path):
    list_ports = pytest.importorskip("serial.tools.list_ports")
    (tmp_path / "radar").symlink_to("/dev/ttyACM0")
    ports = [usb_port("/dev/ttyACM0", "1-4:1.0"), usb_port("/dev/ttyACM5", "1-4:1.3")]
    monkeypatch.setattr(list_ports, "comports", lambda: ports)
    assert second_port(str(tmp_path / "radar")) == "/dev/ttyACM5"
    with pytest.raises(UsageError, match="--board radar: which is its data port"):
        second_port("radar")
