"""Paths on the command line, checked before a command imports what it needs."""

import argparse
import os
import re
import tempfile
from pathlib import Path

from jradar.errors import ModelError, UsageError
from jradar.files import open_file
from jradar.options.outputs import OF_FILES, STREAMS
from jradar.outputs.guard import GuardedFolder, check_replaceable

INPUTS = (  # options that name a file or folder
    *("path", "radar", "replay", "spec", "coupling", "run"),
    *("records", "replay_records"),
)


def is_streamed(output: str) -> bool:
    """True for an output that holds all frames in one file or bag."""
    return Path(output).suffix in STREAMS


def check_paths(options: argparse.Namespace) -> None:
    """Raise OSError for an input that is missing or must not be read.

    Raises ModelError for a missing model, and UsageError for an input that is a pipe or
    a device, and for an output that is of the wrong kind or must not be replaced.
    """
    named = ((name, getattr(options, name, None)) for name in INPUTS)
    inputs = {name: path for name, path in named if path is not None}
    if (radar := inputs.get("radar")) and not os.path.lexists(radar):
        inputs["radar"] = re.sub(r"#\d+$", "", radar)  # a configuration of a log
    several = inputs.pop("path", [])
    several = several if isinstance(several, list) else [several]
    paths = [*several, *inputs.values()]
    for path in inputs.values() if options.recordings else paths:
        _check_input(path)  # each recording later, on its own
    models = getattr(options, "model", None) or []
    models = models if isinstance(models, list) else [models]
    for model in models:
        if os.sep in model and not os.path.exists(model):  # not a shipped model's name
            raise ModelError(f"no model at {model}: no such folder")
    if getattr(options, "output", None) is not None:
        _check_output(options, [*paths, *models])


def _check_input(path: str) -> None:
    if not os.path.lexists(path):
        raise FileNotFoundError(f"no such file or folder: {path}")
    if os.path.isdir(path):
        os.scandir(path).close()
    else:
        open_file(path).close()


def _check_suffix(path: Path, options: argparse.Namespace, folder: bool) -> None:
    """Raise UsageError for a name that promises something else than will be there."""
    several = len(options.recordings)
    known = () if several else options.output_suffixes
    named = (*OF_FILES, *((*STREAMS, *options.output_suffixes) if several else ()))
    if folder and path.suffix in named and not path.is_dir():
        streams = f", or of a file of all frames: {', '.join(STREAMS)}"
        why = f" for {several} recordings" if several else ""
        raise UsageError(
            f"{path} is the name of a file, expected that of a folder{why}"
            f"{streams if options.output_may_stream and not several else ''}"
        )
    if known and path.suffix not in known:
        raise UsageError(f"{path}: expected a name that ends with {' or '.join(known)}")


def _check_writable(path: Path, folder: bool) -> None:
    """Raise OSError if nothing can be written where the output will be.

    A folder is made there and removed: permissions do not bind root, and some file
    systems have rules of their own.
    """
    places = [path, *path.parents] if folder else [*path.absolute().parents]
    above = next(place for place in places if place.is_dir())
    try:
        os.rmdir(tempfile.mkdtemp(prefix=".jradar", dir=above))
    except OSError as error:
        raise OSError(
            f"{path} cannot be written, because {above} takes no files "
            f"({error.strerror}): name another output"
        ) from error


def _check_output(options: argparse.Namespace, inputs: list[str]) -> None:
    path, force = Path(options.output), getattr(options, "force", False)
    several = bool(options.recordings)
    streamed = options.output_may_stream and is_streamed(options.output) and not several
    folder = several or (options.output_is_folder and not streamed)
    if path.is_symlink() and not path.exists():
        raise UsageError(f"{path} is a link to nothing, expected a new name")
    if path.exists() and not streamed and path.is_dir() != folder:
        found, expected = ("file", "folder") if folder else ("folder", "file")
        raise UsageError(f"{path} is a {found}, expected the name of a {expected}")
    for above in path.parents:
        if above.exists() and not above.is_dir():
            raise UsageError(f"{path}: {above} is a file, expected a folder")
    for given in inputs:
        if path.exists() and os.path.exists(given) and path.samefile(given):
            raise UsageError(
                f"{path} is an input of this command, which not even --force "
                "replaces: name another output"
            )
    _check_suffix(path, options, folder)
    _check_writable(path, folder)
    if several:  # see `several.run`
        return
    if folder:
        GuardedFolder(path, options.command.__name__.rstrip("_"), force=force)
    elif not streamed:
        check_replaceable(path, begins=options.output_begins, force=force)
    elif os.path.lexists(path) and not force:
        raise UsageError(
            f"{path} exists and is not overwritten: name another output, or add --force"
        )
