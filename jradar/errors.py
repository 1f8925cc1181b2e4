"""Errors that a user can fix, and the exit codes of all commands.

0    ok
2    usage or config
3    environment: lock held, disk full, missing extra
4    bad data
5    no usable checkpoint or model
130  interrupted (Ctrl-C)
143  ended by SIGTERM; a training has saved its state (`training.loop.Interrupted`)
"""

import contextlib
import errno
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class UsageError(ValueError):
    """A wrong option or config, or an input that the user has to name."""


class ModelError(ValueError):
    """A model that is missing, damaged or of another format."""


class CheckpointError(ValueError):
    """No checkpoint can be used."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, as an exception: unfinished files are removed on the way out."""


EXIT_CODES: dict[type[BaseException], int] = {
    UsageError: 2,
    FileNotFoundError: 2,
    ModelError: 5,
    CheckpointError: 5,
    OSError: 3,
    MemoryError: 3,
    ImportError: 3,
    ValueError: 4,
    FloatingPointError: 4,
    Terminated: 143,
    KeyboardInterrupt: 130,
}


def exit_code(error: BaseException) -> int | None:
    """Return the exit code of an error, or None for a fault of the program.

    Some errors, such as that of a stopped training, have their own `exit_code`.
    """
    kinds, own = EXIT_CODES.items(), getattr(error, "exit_code", None)
    return next((code for kind, code in kinds if isinstance(error, kind)), own)


def printable(text: str) -> str:
    """Return one line of text for a terminal, with control characters escaped.

    Names and messages from files may hold sequences that a terminal obeys, and bytes
    that are not text.
    """
    escaped = (c.encode("unicode_escape").decode("ascii") for c in text)
    pairs = zip(text, escaped, strict=True)
    return "".join(c if c.isprintable() else code for c, code in pairs)


@contextlib.contextmanager
def sigterm_raises() -> Iterator[None]:
    """Raise Terminated in the main thread at SIGTERM; a second one ends at once.

    Python ignores what is raised in a destructor or in a callback of its garbage
    collector, of which JAX has one. From there, Terminated is raised a little later.
    """

    def terminate(number, _):
        signal.signal(number, signal.SIG_DFL)
        raise Terminated("ended by SIGTERM")

    def ignored(fault):
        if not isinstance(fault.exc_value, Terminated):
            return report(fault)
        signal.signal(signal.SIGTERM, terminate)
        again = threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGTERM))
        again.daemon = True
        again.start()

    report, before = sys.unraisablehook, signal.signal(signal.SIGTERM, terminate)
    sys.unraisablehook = ignored
    try:
        yield
    finally:
        sys.unraisablehook = report
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def first_interrupt_noted() -> Iterator[list[int]]:
    """Yield a list that the first Ctrl-C adds to; the second one raises as usual.

    Nothing is noted outside the main thread, and where Ctrl-C is left to another
    process.
    """
    noted: list[int] = []
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        yield noted
        return

    def note(number, _):
        noted.append(number)
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, before)


def check_platform() -> None:
    """Raise OSError if JAX_PLATFORMS asks for devices that are missing."""
    wanted = os.environ.get("JAX_PLATFORMS", "")
    if wanted in ("", "cpu"):
        return
    import jax

    try:
        jax.devices()
    except (AssertionError, RuntimeError) as error:  # from JAX, without the cause
        raise OSError(
            f"JAX_PLATFORMS={wanted}, but JAX finds no such device: install its "
            "driver and plug-in (jradar[cuda]), or unset the variable"
        ) from error


def optional(module: str, *, need: str, extra: str) -> Any:
    """Return a module of a package that an extra of jradar installs.

    Without it, the ImportError begins with `need`, such as "bags need rosbags".
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f"{need}: pip install 'jradar[{extra}]'") from error


@contextlib.contextmanager
def parsing(path: Path | str, what: str) -> Iterator[None]:
    """Turn every error of a parser in the block into a ValueError that names the file.

    `what` is what the file should be, such as "a .npy file". Parsers answer damaged
    bytes with errors of many kinds. Errors of the system, errors of this module and
    messages that already name the file pass unchanged.
    """
    try:
        yield
    except (UsageError, ModelError, CheckpointError, ImportError, FileNotFoundError):
        raise
    except OSError as error:
        if error.errno not in (None, errno.EINVAL):  # from the system, not a parser
            raise
        raise ValueError(_unreadable(path, what, error)) from error
    except Exception as error:
        if isinstance(error, ValueError) and str(path) in str(error):
            raise
        raise ValueError(_unreadable(path, what, error)) from error


def _unreadable(path: Path | str, what: str, error: Exception) -> str:
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return f"{path} is damaged or not {what}: {reason}"
