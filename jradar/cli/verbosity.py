"""How much a command says on stderr, beside its result.

    -q        errors alone: no progress, no hints, no warnings of libraries
    (none)    these, too
    -v        also where each value came from, and how long the command took

The library says such things with the logger "jradar", which is silent in a program
that does not set it up.
"""

import argparse
import contextlib
import logging
import os
import sys
import time
from collections.abc import Iterator

from jradar.cli.printing import say

LOG = logging.getLogger("jradar")


@contextlib.contextmanager
def speaking(options: argparse.Namespace) -> Iterator[None]:
    """Print what the library says, as far as `--quiet` and `--verbose` ask for it."""
    begin, before = time.perf_counter(), (LOG.level, LOG.propagate)
    handler = _Lines()
    LOG.addHandler(handler)
    LOG.setLevel(
        logging.ERROR
        if options.quiet
        else logging.INFO
        if options.verbose
        else logging.WARNING
    )
    LOG.propagate = False
    try:
        yield
        if "jax" in sys.modules:
            folder = os.environ.get("JAX_COMPILATION_CACHE_DIR", "no folder")
            device = sys.modules["jax"].default_backend()
            LOG.info("JAX runs on the %s, compiled programs are in %s", device, folder)
        LOG.info("the command took %.1f s", time.perf_counter() - begin)
    finally:
        LOG.removeHandler(handler)
        LOG.level, LOG.propagate = before


class _Lines(logging.Handler):
    """Prints each record as one line."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        say(record.getMessage())
