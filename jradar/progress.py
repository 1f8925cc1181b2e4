"""Progress on stderr: a bar on a terminal, otherwise a line every ten seconds."""

import contextlib
import datetime
import logging
import math
import sys
import time
from collections.abc import Callable, Iterator

from jradar.errors import printable

SECONDS_BETWEEN_LINES = 10.0

Show = Callable[..., None]


def is_quiet() -> bool:
    """Return whether the logger "jradar" is set to errors alone, as by --quiet."""
    return not logging.getLogger("jradar").isEnabledFor(logging.WARNING)


@contextlib.contextmanager
def progress(
    what: str, total: int, *, first: int = 0, unit: str = ""
) -> Iterator[Show]:
    """Yield `show(done, note)`, to call as `done` rises from `first` to `total`.

    The printed rate leaves out the first item, during which JAX compiles. Nothing is
    printed where the logger "jradar" is set to errors alone.
    """
    if is_quiet():
        yield lambda *_, **__: None
    elif sys.stderr.isatty():
        with _bar(what, total, first, unit) as show:
            yield show
    else:
        yield _lines(what, total, first, unit)


@contextlib.contextmanager
def _bar(what, total, first, unit):
    """A bar with rate and time left."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    rate = _Rate(first, total, unit)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(None),
        TextColumn("{task.completed}/{task.total} {task.fields[note]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(what, total=total, completed=first, note="")

        def show(done, note=""):
            text = printable(f"{note}  {rate(done)}".strip())
            bar.update(task, completed=done, note=text)

        yield show


def _lines(what, total, first, unit):
    """Print a line ten seconds after the last one, and at the end."""
    rate, printed = _Rate(first, total, unit), {"at": -math.inf, "done": first - 1}

    def show(done, note=""):
        speed, now = rate(done), time.monotonic()
        ends = done == total and done != printed["done"]
        if ends or now - printed["at"] >= SECONDS_BETWEEN_LINES:
            printed.update(at=now, done=done)
            parts = (f"{what} {done}/{total}", note, speed)
            text = "  ".join(p for p in parts if p)
            sys.stderr.write(f"{printable(text)}\n")  # at once, or a signal parts them

    return show


class _Rate:
    """Items per second since the first one, and the remaining time."""

    def __init__(self, first, total, unit):
        self.first, self.total, self.unit = first, total, unit
        self.start: tuple[int, float] | None = None

    def __call__(self, done):
        now = time.monotonic()
        if self.start is None:
            if done > self.first:
                self.start = done, now
            return ""
        if done == self.start[0] or now == self.start[1]:
            return ""
        rate = (done - self.start[0]) / (now - self.start[1])
        speed = f"{rate:.2f} {self.unit}/s"
        if rate < 1:
            speed = f"{1 / rate:.2f} s/{self.unit.removesuffix('s')}"
        if done >= self.total:  # what follows, such as writing, is not counted
            return speed
        left = datetime.timedelta(seconds=round((self.total - done) / rate))
        return f"{speed}  left {left}"
