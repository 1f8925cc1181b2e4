"""Warnings, which say why a cloud may not be what it looks like."""

import collections
from collections.abc import Iterator, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from jradar.lidar import shared_field_of_view
from jradar.model import Model
from jradar.options.suiting import KINDS, unsuited
from jradar.radar import Radar, RadarSpec
from jradar.range_image import STRANGE, UNSURE, VIEW
from jradar.recordings import Recording
from jradar.types import PointCloud

NAMED = 5  # frames that a warning names
UNCALIBRATED = (
    "The channels of this radar are not calibrated: record a walk over level ground "
    "for `jradar calibrate --level`"
)
OF_POINTS = (
    "the model was trained on the dense points of a radar's samples, not on those that "
    "a radar sends, which may be better alone or smeared: see `jradar score`"
)
FLAT_POINTS = (
    "the points of this radar all lie in one plane: heights in the result would be "
    "invented by the model. Use `jradar map`, or add --anyway"
)
# A radar that training lacked is more likely to be strange: less is enough to say so.
# Of a real AWR1642 whose range bins are three times those of RadarHD's, every frame is
# less usual than 81 to 86 % of the training frames, and its cloud a blob.
UNUSUAL = 0.8
OTHER_RADAR = ", and the radar is unlike theirs"
MOST_SEEN = 0.8  # share of points in view, below which that is said


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
    def bare(self) -> bool:
        """True if the detector found something, but the cloud has no point."""
        ...

    @property
    def confidence(self) -> float | None:
        """The mean confidence of its points."""
        ...

    @property
    def unlikeness(self) -> float | None:
        """The share of training frames that are more usual."""
        ...


def of_model(model: Model, radar: RadarSpec | None) -> Iterator[str]:
    """Yield why a model of frames may not suit a radar, and what its clouds lack.

    A radar of None sends points.
    """
    grid = model.spec.frame_grid
    if grid.caution:
        yield grid.caution
    if radar is None:
        yield from () if model.card.sent_points else (OF_POINTS,)
    else:
        yield from unsuited(grid.kind, model.card.radars, radar)


def strange_from(model: Model, radar: RadarSpec | None) -> float:
    """Return the unlikeness from which a frame is strange, STRANGE or less.

    It is less for a radar unlike those of the training; None sends points.
    """
    if radar is None:
        return STRANGE
    kind = model.spec.frame_grid.kind
    return UNUSUAL if [*unsuited(kind, model.card.radars, radar)] else STRANGE


def needs_more(model: Model, recording: Recording) -> str:
    """Return what the model needs and the radar does not measure, and what to use."""
    if recording.of_points:
        return "" if recording.has_elevation else FLAT_POINTS
    radar = recording.radar.spec
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

    def __init__(self, strange: float = STRANGE):
        """`strange` is what `strange_from` returns."""
        self._frames, self._strange = 0, strange
        self._least = 1.0  # unlikeness of the strange frames
        self._counts = collections.Counter[str]()
        self._first = collections.defaultdict[str, list[int]](list)

    def add(self, frame: Seen) -> None:
        """Count a frame."""
        self._frames += 1
        sure = frame.confidence
        found = {
            "empty": frame.empty,
            "bare": frame.bare,
            "strange": (frame.unlikeness or 0.0) > self._strange,
            "unsure": sure is not None and sure < UNSURE,
        }
        if found["strange"]:
            self._least = min(self._least, frame.unlikeness or 0.0)
        for fault in (name for name, there in found.items() if there):
            self._counts[fault] += 1
            if len(self._first[fault]) < NAMED:
                self._first[fault].append(frame.number)

    def warnings(self, radar: Radar | None) -> Iterator[str]:
        """Yield one sentence for each fault; a radar that sends points may be None."""
        if count := self._counts["empty"]:
            yield no_echoes(self._first["empty"], count)
        if self._counts["bare"]:
            yield (
                f"no point of {self._which('bare')} is sure enough, and the cloud is "
                "empty: a lower --min-confidence keeps more"
            )
        if count := self._counts["strange"]:
            share, other = STRANGE, ""
            if self._least <= STRANGE:
                share, other = self._strange, OTHER_RADAR
            yield (
                f"{self._which('strange')} {'are' if count > 1 else 'is'} "
                f"unlike {100 * share:.0f} % of the training frames{other}. Is the "
                "radar calibrated, does it move, and does another radar disturb it?"
            )
        if self._counts["unsure"]:
            yield (
                f"do not trust {self._which('unsure')}: the model expects more "
                f"than {100 * (1 - UNSURE):.0f} % of the points to be wrong. "
                "--min-confidence 0.5 leaves out those that are more often wrong than "
                "right"
                + ("" if radar is None or radar.calibrated else f". {UNCALIBRATED}")
            )

    def _which(self, fault: str) -> str:
        """Name a frame, or count several."""
        count, first = self._counts[fault], self._first[fault]
        some = f"frame {first[0]}" if count == 1 else f"{count} frames"
        return some if self._frames == 1 else f"{some} of {self._frames}"


class InView:
    """The points that a radar sent, counted by whether the model sees them."""

    def __init__(self, model: Model):
        """`model` is one of frames."""
        self._view = model.spec.frame_grid.view
        self._points = self._seen = 0

    def add(self, cloud: PointCloud) -> None:
        """Count the points of a frame."""
        xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
        view = {name: getattr(self._view, name) for name in VIEW}
        self._points += len(xyz)
        self._seen += int(shared_field_of_view(xyz, **view).sum())

    def warnings(self) -> Iterator[str]:
        """Yield a warning if a good part of the points is out of view."""
        if self._seen < MOST_SEEN * self._points:
            right, left = np.degrees(self._view.azimuth)
            low, high = np.degrees(self._view.elevation)
            yield (
                f"{1 - self._seen / self._points:.0%} of the points are out of the "
                f"model's view and are not enhanced: it ends at "
                f"{self._view.max_range_m:g} m, azimuths of {right:.0f} to {left:.0f} "
                f"degrees and elevations of {low:.0f} to {high:.0f}"
            )


def no_echoes(first: Sequence[int], count: int) -> str:
    """Return a warning about `count` frames in which the detector found nothing."""
    names = ", ".join(map(str, first)) + (", .." if count > len(first) else "")
    which = f"frame {names}" if count == 1 else f"{count} frames: {names}"
    return f"no echoes in {which}: the detector found nothing, the clouds are empty"
