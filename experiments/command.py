"""What the commands of the experiments share: exit codes, and the studies' parser."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from jradar.errors import (
    UsageError,
    check_platform,
    exit_code,
    printable,
    sigterm_raises,
)


def exit_code_of(run: Callable[[], int | None]) -> int:
    """Run, print an error that the user can fix, and return the exit code."""
    try:
        with sigterm_raises():
            return run() or 0
    except (Exception, KeyboardInterrupt) as error:
        code = exit_code(error)
        if code is None:  # a fault of the program
            raise
        text = " ".join(str(error).split()) or "interrupted"
        print(f"error: {printable(text)}", file=sys.stderr)
        return code


def study_parser(
    module: str, about: str | None, *, output: str = "folder for the results"
) -> argparse.ArgumentParser:
    """Return the parser of a command, without --output if `output` is empty."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {module}",
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if output:
        parser.add_argument("-o", "--output", type=Path, required=True, help=output)
    return parser


def run_study(
    study: Callable[[argparse.Namespace], int | None],
    parser: argparse.ArgumentParser,
    argv: list[str] | None,
) -> int:
    """Parse the arguments, run the study, and return the exit code."""
    options = parser.parse_args(argv)

    def run():
        check_platform()
        if output := getattr(options, "output", None):
            check_output(output)
        return study(options)

    return exit_code_of(run)


def check_output(path: Path) -> None:
    """Raise UsageError if a file lies where a folder of `path` has to be."""
    for parent in path.parents:
        if parent.exists() and not parent.is_dir():
            raise UsageError(f"{parent} is a file, expected a folder")
