# PYTHON_ARGCOMPLETE_OK
"""The command line: info, points, enhance, live, calibrate, prepare and others.

A command parses its options, calls one function of the library, and prints the result.
It loads what it needs when it runs, so `--help`, a wrong option and a wrong path answer
before JAX loads. `jradar.errors` lists the exit codes.
"""

import contextlib
import importlib
import os
import sys
import warnings
from collections.abc import Sequence

from jradar.cli.options import parser
from jradar.cli.paths import check_paths
from jradar.cli.printing import as_json, in_words, lines, say
from jradar.cli.several import begins_several, run
from jradar.cli.verbosity import LOG, speaking
from jradar.errors import check_platform, exit_code, sigterm_raises
from jradar.files import use_compilation_cache


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, print its result, and return the exit code."""
    commands = parser()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks for completions
        with contextlib.suppress(ImportError):
            importlib.import_module("argcomplete").autocomplete(commands)
    options = commands.parse_args(argv)
    use_compilation_cache()
    try:
        with warnings.catch_warnings(), sigterm_raises(), speaking(options):
            warnings.showwarning = lambda text, *_, **__: LOG.warning(
                f"warning: {text}"
            )
            several = begins_several(options)
            check_paths(options)
            check_platform()
            result = run(options) if several else options.command(options)
        text = as_json(result) if options.json else "\n".join(lines(result))
        print(text, flush=True)
        return getattr(result, "code", 0)
    except BrokenPipeError:  # the reader of stdout has seen enough, such as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (Exception, KeyboardInterrupt) as error:
        code = exit_code(error)
        if code is None:
            raise
        say(in_words(error))
        return code
    return 0
