"""The radar board's serial port takes a `.cfg` of TI's mmWave SDK, line by line.

    sent       profileCfg 0 77 267 7 57.14 ..
    received   profileCfg 0 77 267 7 57.14 ..      the board repeats the command,
               Done                                answers, and prints its prompt
               mmwDemo:/>

The board's command port is the first of its two, such as /dev/ttyACM0, at 115,200 baud.
If the board does not know a command, or refuses it, the error names it with its line.
"""

import re
import time
from pathlib import Path
from typing import Any

from jradar.errors import optional
from jradar.files import read_text

BAUD = 115_200
PROMPT = re.compile(rb"[\w-]+:/>\s*$")
REFUSED = re.compile(r"error|not recogni[sz]ed|invalid|assert", re.IGNORECASE)
TIMEOUT_S = 10.0
WAKE_S = 0.1
MOST_ANSWER = 1 << 16  # bytes; a board that prints more runs something else


class Board:
    """A board that takes commands; a `with` block closes its port."""

    def __init__(self, port: str, *, timeout_s: float = TIMEOUT_S):
        """Open the port; OSError, with the fix, if it cannot be opened."""
        need = "the board's serial port needs pyserial"
        serial = optional("serial", need=need, extra="live")
        self.port, self.timeout_s = port, timeout_s
        try:
            self._serial: Any = serial.Serial(port, BAUD, timeout=WAKE_S)
        except (OSError, ValueError) as error:
            raise OSError(
                f"{port} cannot be opened ({error}): is the board on the USB cable "
                "(`ls /dev/ttyACM*`), are you in the group dialout, and is no other "
                "program using the port?"
            ) from error
        self._serial.reset_input_buffer()

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
