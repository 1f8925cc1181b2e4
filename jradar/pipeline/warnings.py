"""Warnings, which say why a cloud may not be what it looks like."""

import collections
from collections.abc import Iterator, Sequence
from typing import Protocol, runtime_checkable

from jradar.model import Model
from jradar.options.suiting import KINDS, unsuited
from jradar.radar import Radar, RadarSpec
from jradar.range_image import STRANGE, UNSURE

NAMED = 5  # frames that a warning names
UNCALIBRATED = (
    "The channels of this radar are not calibrated: record a walk over level ground "
    "for `jradar calibrate --level`"
)


@runtime_checkable
class Seen(Protocol):
    """What the warnings about a frame need to know."""

    @property
    def number(self) -> int:
        """The frame's number."""
        ...

    @property
    def empty(self) -> bool:
        """True if the detector found nothing."""
        ...

    @property
    def confidence(self) -> float | None:
        """The mean confidence of its points."""
        ...

    @property
    def unlikeness(self) -> float | None:
        """The share of training frames that are more usual."""
        ...


def of_model(model: Model, radar: RadarSpec) -> Iterator[str]:
    """Yield why a model of frames may not suit a radar, and what its clouds lack."""
    grid = model.spec.frame_grid
    if grid.caution:
        yield grid.caution
    yield from unsuited(grid.kind, model.card.radars, radar)


def needs_more(model: Model, radar: RadarSpec) -> str:
    """Return what the model needs and this radar does not measure, and what to use."""
    blind, _ = KINDS[model.spec.frame_grid.kind]
    if not (without := blind(radar)):
        return ""
    trained = model.card.radars[0].name if model.card.radars else "other radars"
    plane = ", `--model radarhd` for a cloud in the plane of its antennas"
    return (
        f"{without}. The model was trained on {trained}: use `jradar points`"
        f"{plane if radar.has_azimuth else ''}, or add --anyway"
    )


class Tally:
    """The frames so far, counted by what is wrong with them."""

    def __init__(self):
        self._frames = 0
        self._counts = collections.Counter[str]()
        self._first = collections.defaultdict[str, list[int]](list)

    def add(self, frame: Seen) -> None:
        """Count a frame."""
        self._frames += 1
        sure = frame.confidence
        found = {
            "empty": frame.empty,
            "strange": (frame.unlikeness or 0.0) > STRANGE,
            "unsure": sure is not None and sure < UNSURE,
        }
        for fault in (name for name, there in found.items() if there):
            self._counts[fault] += 1
            if len(self._first[fault]) < NAMED:
                self._first[fault].append(frame.number)

    def warnings(self, radar: Radar) -> Iterator[str]:
        """Yield one sentence for each fault."""
        if count := self._counts["empty"]:
            yield no_echoes(self._first["empty"], count)
        if count := self._counts["strange"]:
            yield (
                f"{self._which('strange')} {'are' if count > 1 else 'is'} "
                f"unlike {100 * STRANGE:.0f} % of the training frames. Is the radar "
                "calibrated, does it move, and does another radar disturb it?"
            )
        if self._counts["unsure"]:
            yield (
                f"do not trust {self._which('unsure')}: the model expects more "
                f"than {100 * (1 - UNSURE):.0f} % of the points to be wrong. "
                "--min-confidence 0.5 keeps few of them, most of which are right"
                + ("" if radar.calibrated else f". {UNCALIBRATED}")
            )

    def _which(self, fault: str) -> str:
        """Name a frame, or count several."""
        count, first = self._counts[fault], self._first[fault]
        some = f"frame {first[0]}" if count == 1 else f"{count} frames"
        return f"{some} of {self._frames}"


def no_echoes(first: Sequence[int], count: int) -> str:
    """Return a warning about `count` frames in which the detector found nothing."""
    names = ", ".join(map(str, first)) + (", .." if count > len(first) else "")
    which = f"frame {names}" if count == 1 else f"{count} frames: {names}"
    return f"no echoes in {which}: the detector found nothing, the clouds are empty"
