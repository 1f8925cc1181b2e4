"""Paths on the command line, checked before a command imports what it needs."""

import argparse
import os
from pathlib import Path

from jradar.errors import ModelError, UsageError
from jradar.files import open_file

INPUTS = ("path", "radar", "replay", "spec", "coupling", "run")  # name a file
STREAMED = (".mcap", ".ros2")  # outputs that hold all frames in one file or bag


def is_streamed(output: str) -> bool:
    """True for an output that holds all frames in one file or bag."""
    return Path(output).suffix in STREAMED


def check_paths(options: argparse.Namespace) -> None:
    """Raise OSError for an input that is missing or must not be read.

    Raises ModelError for a missing model, and UsageError for an input that is a pipe or
    a device, an output that is a file instead of a folder, or a folder instead of a
    file.
    """
    for name in INPUTS:
        if (path := getattr(options, name, None)) is not None:
            _check_input(path)
    model = getattr(options, "model", None) or ""
    if os.sep in model and not os.path.exists(model):  # no name of a shipped model
        raise ModelError(f"no model at {model}: no such folder")
    if (output := getattr(options, "output", None)) is not None:
        streamed = is_streamed(output) and options.output_may_stream
        if streamed and os.path.lexists(output):
            raise UsageError(f"{output} exists and is not overwritten: name another")
        _check_output(Path(output), folder=options.output_is_folder and not streamed)


def _check_input(path: str) -> None:
    if not os.path.lexists(path):
        raise FileNotFoundError(f"no such file or folder: {path}")
    if os.path.isdir(path):
        os.scandir(path).close()
    else:
        open_file(path).close()


def _check_output(path: Path, *, folder: bool) -> None:
    if path.exists() and path.is_dir() != folder:
        found, expected = ("file", "folder") if folder else ("folder", "file")
        raise UsageError(f"{path} is a {found}, expected the name of a {expected}")
    for above in path.parents:
        if above.exists() and not above.is_dir():
            raise UsageError(f"{path}: {above} is a file, expected a folder")
