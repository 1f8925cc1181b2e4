"""Why a cloud may not be what it looks like, in words."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from jradar.model import Card
from jradar.planar import MAX_RANGE_M, PlanarModel, azimuth_row
from jradar.radar import Radar, RadarSpec
from jradar.range_image import STRANGE, UNSURE
from jradar.recordings.configuration import blind as blind, differences, unsuited

if TYPE_CHECKING:
    from jradar.session.frames import Frame
    from jradar.session.models import AnyModel

IN_THE_PLANE = "`--model radarhd` for a cloud in the plane of its antennas"
PLANAR = "height is not measured: all points lie at height 0"
UNCALIBRATED = (
    "The channels of this radar are not calibrated: record a walk over level ground "
    "for `jradar calibrate --level`"
)


def of_model(model: "AnyModel", radar: RadarSpec) -> Iterator[str]:
    """Yield why a model of either kind may not suit a radar, and what it leaves out."""
    if isinstance(model, PlanarModel):
        yield PLANAR
        yield from differences(model.card.radars, radar, _view_in_plane)
    else:
        yield from of_radar(model.card, radar)


def of_radar(card: Card, radar: RadarSpec) -> Iterator[str]:
    """Yield why a model may not suit this radar."""
    yield from unsuited(card.radars, radar)


def of_frames(frames: "Sequence[Frame]", radar: Radar) -> Iterator[str]:
    """Yield what is wrong with some of the frames, one sentence for each fault."""
    empty = [f.number for f in frames if f.empty]
    strange = [f.number for f in frames if (f.unlikeness or 0.0) > STRANGE]
    trusts = ((f.number, f.confidence) for f in frames)
    unsure = [n for n, trust in trusts if trust is not None and trust < UNSURE]
    yield from no_echoes(empty)
    if strange:
        yield (
            f"{_which(strange)} of {len(frames)} {'are' if strange[1:] else 'is'} "
            f"unlike {100 * STRANGE:.0f} % of the training frames. Is the radar "
            "calibrated, does it move, does another radar disturb it?"
        )
    if unsure:
        yield (
            f"do not trust {_which(unsure)} of {len(frames)}: the model expects more "
            f"than {100 * (1 - UNSURE):.0f} % of the points to be wrong. "
            "--min-confidence 0.5 keeps few of them, most of which are right"
            + ("" if radar.calibrated else f". {UNCALIBRATED}")
        )


def no_echoes(empty: Sequence[int]) -> Iterator[str]:
    """Yield a warning about the frames in which the detector found nothing."""
    names = ", ".join(map(str, empty[:5])) + (", .." if empty[5:] else "")
    which = f"frame {names}" if len(empty) == 1 else f"{len(empty)} frames: {names}"
    if empty:
        yield f"no echoes in {which}: the detector found nothing, the clouds are empty"


def _which(frames: list[int]) -> str:
    """Name a frame, or count several."""
    return f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames"


def _view_in_plane(radar: RadarSpec) -> dict[str, float]:
    """Return what the look of a radar's polar images depends on, likewise."""
    return {
        "range to {:.3g} m": min(radar.max_range_m, MAX_RANGE_M),
        "range bins of {:.3g} m": radar.range_resolution_m,
        "{:.0f} antennas in a row": float(len(azimuth_row(radar)[0])),
    }
