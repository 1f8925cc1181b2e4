"""One line on stderr: the errors of all commands and of their parser."""

import argparse
import difflib
import sys
from typing import NoReturn

from jradar.errors import printable


def say(text: str) -> None:
    """Print a line, with control characters escaped."""
    line = " ".join(text.split())
    print(f"jradar: {printable(line)}", file=sys.stderr, flush=True)


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the nearest known option."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and end with code 2."""
        wrong = message.removeprefix("unrecognized arguments: ").split()[0]
        if wrong.startswith("-"):
            wrong = wrong.partition("=")[0]
            near = difflib.get_close_matches(wrong, self.known_options(), 1)
            message += "".join(f", did you mean {name}?" for name in near)
        line = printable(f"{self.prog}: {message} (see {self.prog} --help)")
        self.exit(2, f"{line}\n")

    def known_options(self) -> set[str]:
        """Return the options of this parser and of its commands."""
        known = {*self._option_string_actions}
        for action in self._actions:
            if isinstance(action.choices, dict):  # the commands
                known |= {o for p in action.choices.values() for o in p.known_options()}
        return known
