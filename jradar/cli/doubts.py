"""Why the result of `jradar enhance` may not be what it looks like, in words."""

from collections.abc import Iterator
from typing import Any

from jradar.model import ModelSpec
from jradar.radar import RadarSpec
from jradar.range_image import STRANGE, UNSURE

TOLERANCE = 0.05  # up to which two radars count as alike
FLAT = (
    "this radar has one row of antennas and measures no elevation: heights in the "
    "result are invented by the model"
)

NARROW = (
    "this radar has one column of antennas and measures no azimuth: directions in the "
    "result are invented by the model"
)


UNCALIBRATED = (
    "The channels of this radar are not calibrated: record a walk over level ground "
    "for `jradar calibrate --level`"
)


def of_radar(spec: ModelSpec, radar: RadarSpec):
    """Yield why the model may not suit this radar."""
    if without := blind(radar):
        yield without
    trained = [_waveform(seen) for seen in (spec.radar, *spec.other_radars)]
    differ = [
        f"{name.format(value)} here, {_span(known)} in training"
        for name, value in _waveform(radar).items()
        for known in [[waveform[name] for waveform in trained]]
        if not min(known) * (1 - TOLERANCE) <= value <= max(known) * (1 + TOLERANCE)
    ]
    if differ:
        yield (
            f"the model was trained on other radars ({spec.radar.name}), expect worse "
            f"clouds: {'; '.join(differ)}"
        )


def blind(radar: RadarSpec) -> str:
    """Which angle the radar does not measure, in words; "" if it measures both."""
    if not radar.has_elevation:
        return FLAT
    return "" if radar.has_azimuth else NARROW


def strangers(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield a warning for frames unlike those of training."""
    strange = [r for r in rows if r.get("unlike training (%)", 0) > 100 * STRANGE]
    if strange:
        yield (
            f"{_which(strange)} of {len(rows)}: the radar points look like less than "
            f"{100 * (1 - STRANGE):.0f} % of the training frames. Is the radar "
            "calibrated, does it move, does another radar disturb it?"
        )


def unsure(rows: list[dict[str, Any]], *, calibrated: bool) -> Iterator[str]:
    """Yield a warning for clouds of which half or more is probably wrong.

    It names the mend for a radar whose channels are not `calibrated`.
    """
    found = [r for r in rows if r.get("confidence (%)", 100) < 100 * UNSURE]
    if found:
        yield (
            f"do not trust {_which(found)} of {len(rows)}: the model expects more "
            f"than {100 * (1 - UNSURE):.0f} % of the points to be wrong. "
            "--min-confidence 0.5 keeps the better ones"
            + ("" if calibrated else f". {UNCALIBRATED}")
        )


def _which(rows: list[dict[str, Any]]) -> str:
    """Name a frame, or count several."""
    return f"frame {rows[0]['frame']}" if len(rows) == 1 else f"{len(rows)} frames"


def _span(values: list[float]) -> str:
    """Write the smallest and the largest value, once if they are the same."""
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"


def _waveform(radar: RadarSpec) -> dict[str, float]:
    """Return what the look of a radar's points depends on, by its words in a note."""
    return {
        "range to {:.3g} m": radar.max_range_m,
        "range bins of {:.3g} m": radar.range_resolution_m,
        "velocity to {:.3g} m/s": radar.max_velocity_mps,
        "carrier at {:.3g} GHz": radar.center_frequency_hz / 1e9,
        "{:.0f} virtual antennas": float(radar.num_virtual),
    }
