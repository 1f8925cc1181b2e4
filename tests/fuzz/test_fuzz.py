"""Damaged files end in a result or in an error that names the file, soon and small.

    pytest tests/fuzz                              0.3 s for each reader
    JRADAR_FUZZ_SECONDS=5 pytest tests/fuzz        more
    pytest -m hours tests/fuzz                     60 s for each reader

A failure names its target and example; `python -m tests.fuzz.test_fuzz NAME EXAMPLE`
runs that one again.
"""

import contextlib
import os
import resource
import shutil
import sys
import tempfile
import time
import warnings
from pathlib import Path

import pytest

from tests.fuzz.mutate import mutated
from tests.fuzz.targets import TARGETS

SECONDS = float(os.environ.get("JRADAR_FUZZ_SECONDS", "0.15"))
SLOW_SECONDS = 60.0
LONG = (pytest.mark.slow, pytest.mark.hours, pytest.mark.timeout(600))
LONGEST_S = 10.0  # of one file
MORE_MEMORY = 1 << 30  # bytes that reading may take
LIMIT = 4 << 30  # bytes beyond which the system refuses memory


@pytest.fixture(autouse=True)
def memory_limit():
    """Limit the memory of this process to what it has and `LIMIT` more."""
    fields = Path("/proc/self/status").read_text().split("VmData:")[1].split()
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = 1024 * int(fields[0]) + LIMIT
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    yield
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def peak_bytes() -> int:
    """The largest memory that this process has held."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def outcome(target, content: bytes, folder: Path) -> str:
    """Read damaged content; returns what went wrong, or nothing."""
    target.path.write_bytes(content)
    begin, before = time.monotonic(), peak_bytes()
    try:
        with open(os.devnull, "w") as nowhere, contextlib.redirect_stderr(nowhere):
            target.read()
    except (ValueError, OSError) as error:
        if target.path.name not in str(error) and str(folder) not in str(error):
            return f"no file in {type(error).__name__}: {error}"[:200]
    except Exception as error:  # noqa: BLE001
        return f"{type(error).__name__}: {error}"[:200]
    seconds, more = time.monotonic() - begin, peak_bytes() - before
    if seconds > LONGEST_S:
        return f"{seconds:.1f} s"
    return f"{more:,} bytes of memory" if more > MORE_MEMORY else ""


def fuzz(name: str, seconds: float, folder: Path) -> tuple[int, list[str]]:
    """Read damaged files for some seconds; returns their number and the failures."""
    target = TARGETS[name](folder)
    content = target.path.read_bytes()
    target.read()  # the whole file is read without an error
    found: dict[str, str] = {}
    example, end = 0, time.monotonic() + seconds
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        while time.monotonic() < end:
            damaged = mutated(content, f"{name} {example}", head=target.head)
            if wrong := outcome(target, damaged, folder):
                found.setdefault(wrong.split(":")[0], f"{name} {example}: {wrong}")
            example += 1
    return example, [*found.values()]


@pytest.mark.parametrize("name", TARGETS)
@pytest.mark.parametrize(
    "seconds", [SECONDS, pytest.param(SLOW_SECONDS, marks=LONG)], ids=["soon", "long"]
)
def test_damaged_files_are_read_or_refused(name, seconds, tmp_path):
    examples, failures = fuzz(name, seconds, tmp_path)
    print(f"{name}: {examples} examples, peak {peak_bytes() >> 20} MB")
    assert not failures and examples > 0


def again(name: str, example: str) -> None:
    """Read one damaged file without a net, to see the traceback."""
    folder = Path(tempfile.mkdtemp())
    target = TARGETS[name](folder)
    content = target.path.read_bytes()
    target.path.write_bytes(mutated(content, f"{name} {example}", head=target.head))
    print(target.path.read_bytes()[:2000])
    try:
        target.read()
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    again(*sys.argv[1:])
