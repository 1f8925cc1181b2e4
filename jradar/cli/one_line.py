"""The parser of all commands, whose errors are one line."""

import argparse
import difflib
from typing import NoReturn


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, with the nearest known option."""

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and end with code 2."""
        wrong = message.removeprefix("unrecognized arguments: ").split()[0]
        if wrong.startswith("-"):
            wrong = wrong.partition("=")[0]
            near = difflib.get_close_matches(wrong, self.known_options(), 1)
            message += "".join(f", did you mean {name}?" for name in near)
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")

    def known_options(self) -> set[str]:
        """Return the options of this parser and of its commands."""
        known = {*self._option_string_actions}
        for action in self._actions:
            if isinstance(action.choices, dict):  # the commands
                known |= {o for p in action.choices.values() for o in p.known_options()}
        return known
