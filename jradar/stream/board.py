"""The radar board's serial port takes a `.cfg` of TI's mmWave SDK, line by line.

    sent       profileCfg 0 77 267 7 57.14 ..
    received   profileCfg 0 77 267 7 57.14 ..      the board repeats the command,
               Done                                answers, and prints its prompt
               mmwDemo:/>

The board's command port is the first of its two, such as /dev/ttyACM0, at 115,200 baud.
If the board does not know a command, or refuses it, the error names it with its line.
Over the second, its data port, it sends the points that it found: `points_port`.
"""

import os
import re
import time
from pathlib import Path
from typing import Any

from jradar.errors import UsageError, optional
from jradar.files import read_text

BAUD = 115_200
PROMPT = re.compile(rb"[\w-]+:/>\s*$")
REFUSED = re.compile(r"error|not recogni[sz]ed|invalid|assert", re.IGNORECASE)
TIMEOUT_S = 10.0
WAKE_S = 0.1
MOST_ANSWER = 1 << 16  # bytes; a board that prints more runs something else


def open_port(port: str, baud: int) -> Any:
    """Open a serial port, which no other jradar can open meanwhile.

    Raises OSError, with the fix, if it cannot be opened.
    """
    serial = _pyserial("serial")
    try:
        return serial.Serial(port, baud, timeout=WAKE_S, exclusive=True)
    except (OSError, ValueError) as error:
        raise OSError(
            f"{port} cannot be opened ({error}): is the board on the USB cable "
            "(`ls /dev/ttyACM* /dev/ttyUSB*`), are you in the group dialout, and is no "
            "other program using the port?"
        ) from error


def second_port(port: str) -> str:
    """Return the data port of the board with this command port.

    That is the other port of the same USB device, or else the next number:
    /dev/ttyACM1 after /dev/ttyACM0. UsageError for a name without a number.
    """
    known = _pyserial("serial.tools.list_ports").comports()
    name = os.path.realpath(port) if os.path.islink(port) else port
    here = next((info for info in known if info.device == name), None)
    if here is not None and here.location:
        ports = sorted(
            (info for info in known if _device(info) == _device(here)), key=_place
        )
        after = [*ports[ports.index(here) + 1 :], *ports[: ports.index(here)]]
        if after:
            return after[0].device
    if number := re.search(r"\d+$", name):
        return f"{name[: number.start()]}{int(number[0]) + 1}"
    raise UsageError(f"--board {port}: which is its data port? Name it, --points PORT")


def _device(info: Any) -> tuple:
    """Return what ports of one USB device share; the rest of a location is its part."""
    return info.vid, info.pid, info.serial_number, (info.location or "").split(":")[0]


def _place(info: Any) -> list[tuple[int, str]]:
    """Return a key that sorts ports by their numbers."""
    parts = re.findall(r"\d+|\D+", f"{info.location} {info.device}")
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def _pyserial(module: str) -> Any:
    need = "the board's serial ports need pyserial"
    return optional(module, need=need, extra="live")


class Board:
    """A board that takes commands; a `with` block closes its port."""

    def __init__(self, port: str, *, timeout_s: float = TIMEOUT_S):
        """Open the port; OSError, with the fix, if it cannot be opened."""
        self.port, self.timeout_s = port, timeout_s
        self._serial = open_port(port, BAUD)

    def __enter__(self) -> "Board":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Close the port; the board keeps running."""
        self._serial.close()

    def configure(self, path: Path | str) -> None:
        """Send every command of a `.cfg`; its `sensorStart` starts the radar.

        After a file without one, `sensorStart` is sent, too. Raises TimeoutError for a
        board that does not answer, and ValueError, with the line, for a command that it
        refuses.
        """
        started = False
        for number, line in enumerate(read_text(path).splitlines(), 1):
            command = re.split("[%#]", line)[0].strip()
            if command:
                self.send(command, source=f"{path}, line {number}: ")
                started |= command.split()[0] == "sensorStart"
        if not started:
            self.send("sensorStart")

    def stop(self) -> None:
        """Stop the radar."""
        self.send("sensorStop")

    def send(self, command: str, *, source: str = "") -> str:
        """Send a command and return the board's answer; errors begin with `source`."""
        self._serial.write(command.encode("ascii", "replace") + b"\n")
        raw, end = bytearray(), time.monotonic() + self.timeout_s
        while not PROMPT.search(raw):
            if time.monotonic() > end or len(raw) > MOST_ANSWER:
                raise TimeoutError(self._no_answer(command, source, bytes(raw)))
            raw += self._serial.read(max(self._serial.in_waiting, 1))
        text = PROMPT.sub(b"", bytes(raw)).decode("utf-8", "replace")
        answer = " ".join(text.replace(command, "", 1).split())
        if REFUSED.search(answer):
            raise ValueError(
                f"{source}{command!r}: the board answers {answer[:200]!r}. Does the "
                ".cfg belong to this board and SDK? After a failed start, switch it "
                "off and on"
            )
        return answer

    def _no_answer(self, command: str, source: str, raw: bytes) -> str:
        heard = f"only {raw[-80:]!r}" if raw else "nothing"
        return (
            f"{source}{command!r}: the board on {self.port} did not answer within "
            f"{self.timeout_s:g} s ({heard} was heard): is it the command port (the "
            "first of the two), does the board run the SDK's demo (SOP 2 open), and "
            "is it powered? Press its reset button and try again"
        )
