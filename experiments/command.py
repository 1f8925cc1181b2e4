"""What the commands of the experiments share: exit codes, and the studies' parser."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from jradar.errors import exit_code


def exit_code_of(run: Callable[[], int | None]) -> int:
    """Run, print an error that the user can mend, and return the exit code."""
    try:
        return run() or 0
    except (Exception, KeyboardInterrupt) as error:
        code = exit_code(error)
        if code is None:  # a fault of the program
            raise
        if not isinstance(error, KeyboardInterrupt):
            print(f"error: {error}", file=sys.stderr)
        return code


def study_parser(
    name: str, about: str | None, *, output: str = "folder for the results"
) -> argparse.ArgumentParser:
    """Return the parser of a study, without --output if `output` is empty."""
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.studies.{name}",
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if output:
        parser.add_argument("-o", "--output", type=Path, required=True, help=output)
    return parser


def run_study(
    study: Callable[[argparse.Namespace], None],
    parser: argparse.ArgumentParser,
    argv: list[str] | None,
) -> int:
    """Parse the arguments, run the study, and return the exit code."""
    options = parser.parse_args(argv)
    return exit_code_of(lambda: study(options))
