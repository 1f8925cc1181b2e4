"""Values of options: each function parses one kind, and says what it expects."""

import argparse
import functools
import math

MAX_CELLS = 32  # on a side of a CFAR window; more take minutes to compile


def frames(text: str) -> slice:
    """Parse a range A:B of frames; either end can be left out."""
    first, colon, last = text.partition(":")
    if not colon or not all(part.isdecimal() or not part for part in (first, last)):
        raise argparse.ArgumentTypeError(f"{text!r}, expected A:B, such as 0:100")
    chosen = slice(*(int(part) if part else None for part in (first, last)))
    if chosen.stop is not None and chosen.stop <= (chosen.start or 0):
        raise argparse.ArgumentTypeError(f"{text!r} holds no frame, expected A < B")
    return chosen


def whole(least: int, most: int, text: str) -> int:
    """Parse a whole number from `least` to `most`."""
    short = len(text) <= len(str(most))
    if not (short and text.isdecimal() and least <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"{text!r}, expected {least} to {most}")
    return int(text)


def cells(text: str) -> tuple[int, int]:
    """Parse numbers of cells D,R."""
    doppler, comma, range_ = text.partition(",")
    if not comma:
        raise argparse.ArgumentTypeError(f"{text!r}, expected D,R, such as 2,4")
    return whole(0, MAX_CELLS, doppler), whole(0, MAX_CELLS, range_)


def number(text: str) -> float:
    """Parse a number; NaN, which fits no limits, for anything else."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def positive(text: str) -> float:
    """Parse a finite number above 0."""
    if not 0 < number(text) < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}, expected a number above 0")
    return number(text)


def angle(text: str) -> float:
    """Parse degrees above 0 into radians."""
    return math.radians(positive(text))


def share(text: str) -> float:
    """Parse a number from 0 to 1."""
    if not 0 <= number(text) <= 1:
        raise argparse.ArgumentTypeError(f"{text!r}, expected 0 to 1")
    return number(text)


def reflector(text: str) -> tuple[float, float, float]:
    """Parse a range in metres, and a direction in degrees, into metres and radians."""
    distance, *direction = map(number, text.split(","))
    azimuth, elevation = direction if len(direction) == 2 else (0.0, 0.0)
    fits = 0 < distance < math.inf and abs(azimuth) < 90 and abs(elevation) < 90
    if not fits or len(direction) not in (0, 2):
        raise argparse.ArgumentTypeError(
            f"{text!r}, expected a range above 0, or M,AZ,EL such as 3.2,-10,0"
        )
    return distance, math.radians(azimuth), math.radians(elevation)


port = functools.partial(whole, 0, 65_535)  # 0 takes a free one
seed_value = functools.partial(whole, 0, 2**32 - 1)
places = functools.partial(whole, 0, 1000)  # by which a packet may be late
