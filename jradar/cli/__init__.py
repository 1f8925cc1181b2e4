"""The command line: info, points, enhance, prepare, simulate, view, export.

Heavy modules are imported by the command that needs them, so that `--help` and a wrong
option answer at once. Exit codes: 0 ok, 2 usage, 3 environment, 4 bad data, 5 no usable
weights.
"""

import json
import os
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from jradar.cli.listing import lines
from jradar.cli.options import parser
from jradar.files import use_compilation_cache


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    options = parser().parse_args(argv)
    use_compilation_cache()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _print(options.command(options), options.json)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        code = _exit_code(error)
        if code is None:
            raise
        print(f"jradar: {error}", file=sys.stderr)
        return code


def _print(result: dict[str, Any], as_json: bool) -> int:
    """The result on stdout, as JSON or as lines."""
    text = json.dumps(result, indent=2) if as_json else "\n".join(lines(result))
    print(text, flush=True)
    return 0


def _show_warning(message, *_args, **_kwargs):
    """A warning as one line, without the place in the code that a user cannot mend."""
    print(f"jradar: warning: {message}", file=sys.stderr)


def _exit_code(error):
    """Exit code of an error that a user can mend; None for a fault of ours."""
    from jradar.bundle import BundleError

    codes = {
        BundleError: 5,
        FileNotFoundError: 2,
        ValueError: 4,
        OSError: 3,
        ImportError: 3,
    }
    return next((code for kind, code in codes.items() if isinstance(error, kind)), None)
