"""Programs that tests start, disturb and wait for."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def started(module, *arguments, **options):
    """Start `python -m MODULE` from the repository's root; what it prints is text."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.Popen(command, cwd=ROOT, **pipes | options)


def finished(code):
    """Run lines of Python from the repository's root."""
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def pasted(lines, folder, environment):
    """Paste lines into one shell, in a folder; return what they print."""
    return ran(["bash", "-c", "\n".join(["set -e", *lines])], folder, environment)


def ran(words, folder, environment=None):
    """What a program prints that ends well."""
    options = {"cwd": folder, "env": environment, "capture_output": True, "text": True}
    done = subprocess.run(words, **options)
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout
