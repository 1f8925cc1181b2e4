"""Errors that a user can mend, and the exit codes of all commands.

0    ok
2    usage or config
3    environment: lock held, disk full, missing extra
4    bad data
5    no usable checkpoint or model
130  interrupted (Ctrl-C)
143  ended by SIGTERM; a training has saved its state (`training.Interrupted`)
"""

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path


class UsageError(ValueError):
    """A wrong option or config, or an input that the user has to name."""


class ModelError(ValueError):
    """A model that is missing, damaged or of another format."""


class CheckpointError(ValueError):
    """Checkpoints of which none can be used."""


class Terminated(KeyboardInterrupt):
    """SIGTERM, as an exception: unfinished files are removed on the way out."""


EXIT_CODES: dict[type[BaseException], int] = {
    UsageError: 2,
    FileNotFoundError: 2,
    ModelError: 5,
    CheckpointError: 5,
    OSError: 3,
    ImportError: 3,
    ValueError: 4,
    FloatingPointError: 4,
    Terminated: 143,
    KeyboardInterrupt: 130,
}
NO_DEVICE = ("Unable to initialize backend", "Unknown backend")  # RuntimeError of JAX


def exit_code(error: BaseException) -> int | None:
    """Return the exit code of an error, or None for a fault of the program."""
    if isinstance(error, RuntimeError) and str(error).startswith(NO_DEVICE):
        return EXIT_CODES[OSError]
    kinds = EXIT_CODES.items()
    return next((code for kind, code in kinds if isinstance(error, kind)), None)


def terminate_on_sigterm() -> None:
    """Raise Terminated in the main thread at SIGTERM; a second one ends at once."""

    def terminate(number, _):
        signal.signal(number, signal.SIG_DFL)
        raise Terminated

    signal.signal(signal.SIGTERM, terminate)


@contextlib.contextmanager
def parsing(path: Path | str, what: str) -> Iterator[None]:
    """Raise ValueError that names the file for every error of a parser in the block.

    `what` is what the file should be, such as "a .npy file". Parsers answer damaged
    bytes with errors of many kinds. Errors of the system, errors of this module and
    messages that already name the file pass unchanged.
    """
    try:
        yield
    except (UsageError, ModelError, CheckpointError, ImportError):
        raise
    except OSError as error:
        if error.errno is not None:  # of the system; parsers raise it without a number
            raise
        raise ValueError(_unreadable(path, what, error)) from error
    except Exception as error:
        if isinstance(error, ValueError) and str(path) in str(error):
            raise
        raise ValueError(_unreadable(path, what, error)) from error


def _unreadable(path: Path | str, what: str, error: Exception) -> str:
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return f"{path} is damaged or not {what}: {reason}"
