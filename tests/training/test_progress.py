"""Progress of long runs: time per step, days that are left."""

import io
import sys

import pytest

from jradar.progress import progress


@pytest.mark.parametrize(
    ("seconds", "total", "expected"),
    [
        (0.5, 221, "2.00 steps/s  left 0:01:40"),
        (4.0, 100_019, "4.00 s/step  left 4 days, 15:06:40"),
    ],
)
def test_rate_leaves_the_first_step_out(capsys, monkeypatch, seconds, total, expected):
    now = 1000.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    with progress("training", total, unit="steps") as show:
        now += 600  # compiling
        show(1)
        for done in range(2, 22):
            now += seconds
            show(done)
    assert expected in capsys.readouterr().err


def test_without_a_terminal_it_is_a_line_at_start_and_end(capsys):
    with progress("counting", 3, unit="items") as show:
        for done in (1, 2, 3, 3, 3):
            show(done, "fine")
    first, last = capsys.readouterr().err.splitlines()
    assert first == "counting 1/3  fine"
    assert last.startswith("counting 3/3  fine") and "items/s" in last


def test_a_signal_cannot_part_a_line_from_its_end(monkeypatch):
    pieces = []

    class Stderr(io.StringIO):
        def write(self, text):
            pieces.append(text)
            return len(text)

    monkeypatch.setattr(sys, "stderr", Stderr())
    with progress("counting", 1) as show:
        show(1, "fine")
    assert pieces == ["counting 1/1  fine\n"]
