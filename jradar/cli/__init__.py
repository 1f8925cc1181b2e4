"""The command line: info, points, enhance, prepare, simulate, view, export.

A command imports what it needs when it runs, so `--help` and a wrong option answer
before JAX loads. `jradar.errors` lists the exit codes.
"""

import json
import os
import sys
import warnings
from collections.abc import Sequence

from jradar.cli.listing import lines
from jradar.cli.options import parser
from jradar.errors import exit_code
from jradar.files import use_compilation_cache


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, print its result, and return the exit code."""
    options = parser().parse_args(argv)
    use_compilation_cache()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            result = options.command(options)
        text = (
            json.dumps(result, indent=2) if options.json else "\n".join(lines(result))
        )
        print(text, flush=True)
    except BrokenPipeError:  # the reader of stdout has seen enough, such as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (Exception, KeyboardInterrupt) as error:
        code = exit_code(error)
        if code is None:
            raise
        print(f"jradar: {str(error) or type(error).__name__}", file=sys.stderr)
        return code
    return 0


def _show_warning(message, *_args, **_kwargs):
    """Print a warning as one line, without its place in the code."""
    print(f"jradar: warning: {message}", file=sys.stderr)
