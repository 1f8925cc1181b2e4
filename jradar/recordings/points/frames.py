"""Frames of columns to a `Recording` of points, and what `jradar info` says of them."""

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.recordings.points.fields import FORWARD, Layout, are_points, match_fields
from jradar.recordings.recording import Recording, Stream

if TYPE_CHECKING:
    from jradar import PointCloud

LOOKED_AT = 40  # frames, evenly spaced, from which a layout follows
DESCRIBED = 200  # frames of which `describe_points` reads the points
JUMP = 20.0  # median steps between two stamps
STATIC_MPS = 0.15  # within which a point's velocity is that of a static world
HYPOTHESES = 60
LEAST_POINTS = 8
BACKWARDS_MPS = 2.0
LEAST_SHARE = 0.5


def points_recording(
    path: Path,
    frames: Stream,
    *,
    name: str | None = None,
    fields: dict[str, str] | None = None,
    forward: str | None = None,
    decibels: Collection[str] | None = None,
    approaching: bool = False,
    notes: tuple[str, ...] = (),
    **others: Any,
) -> Recording:
    """Return the recording of `frames`, a stream of columns by name.

    `fields` and the options after it are as in `Layout.of`; by default the columns are
    known by their names. `others` are fields of the `Recording`, `base_from_radar` for
    points along the axes of the file. Raises UsageError without frames, and ValueError
    for columns without places.
    """
    if not len(frames):
        raise UsageError(f"{path} holds no frame of points")
    chosen = np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).round().astype(int))
    seen = [frames[int(k)] for k in chosen]
    if fields is None:
        names = [*dict.fromkeys(name for columns in seen for name in columns)]
        fields = match_fields(names)
        if not are_points(fields):
            raise ValueError(
                f"{path} has the columns {', '.join(names)}, expected x, y and z, or "
                "range and azimuth"
            )
    layout = Layout.of(
        fields, seen, forward=forward, decibels=decibels, approaching=approaching
    )
    stamps, odd = checked_stamps(frames.stamps)
    odd += (
        *layout.notes(seen),
        *_backwards([layout.cloud(columns) for columns in seen]),
    )
    if (mount := others.get("base_from_radar")) is not None:
        turn = np.eye(4)
        turn[:3, :3] = FORWARD[layout.forward].T
        others["base_from_radar"] = mount @ turn
    points = Stream(lambda k: layout.cloud(frames[k]), len(frames), stamps)
    return Recording(
        name=path.stem if name is None else name,
        path=path,
        points=points,
        fields=tuple(layout.describe().items()),
        notes=(*notes, *frames.notes, *odd),
        **others,
    )


def checked_stamps(
    stamps: Float[np.ndarray, " frame"] | None,
) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """Return the stamps, or None if they say nothing; and notes on them."""
    if stamps is None or len(stamps) < 2:
        return stamps, ()
    if not np.isfinite(stamps).all() or not np.ptp(stamps):
        return None, ("the frames' stamps are all alike or NaN: no times are known",)
    steps = np.diff(stamps)
    usual, notes = np.median(steps[steps > 0]) if (steps > 0).any() else 0.0, ()
    if wrong := int((steps <= 0).sum()):
        notes += (f"the stamps of {wrong} frames do not rise",)
    if usual and (jumps := int((steps > JUMP * usual).sum())):
        longest = f"the longest of {steps.max():.3f} s, usually {usual:.3f}"
        notes += (f"the stamps jump {jumps} times, {longest}",)
    return stamps, notes


def describe_points(points: Stream) -> dict[str, Any]:
    """Return sizes, the field of view seen and the spans of what was measured."""
    chosen = np.unique(np.linspace(0, len(points) - 1, DESCRIBED).round().astype(int))
    clouds = [points[int(k)] for k in chosen]
    sizes = [len(cloud.valid) for cloud in clouds]
    found: dict[str, Any] = {
        "frames read": len(clouds),
        "points a frame": f"{np.median(sizes):,.0f}, {min(sizes):,} to {max(sizes):,}",
        "empty frames": int(np.equal(sizes, 0).sum()),
    }
    if not sum(sizes):
        return found
    xyz = np.concatenate([np.asarray(cloud.xyz, float) for cloud in clouds])
    distance = np.linalg.norm(xyz, axis=1)
    found["range (m)"] = _span(distance, "{:.2f}")
    found["azimuth (deg)"] = _span(np.degrees(np.arctan2(xyz[:, 1], xyz[:, 0])))
    heights = np.degrees(np.arcsin(np.clip(xyz[:, 2] / distance, -1, 1)))
    found["elevation (deg)"] = _span(heights) if xyz[:, 2].any() else "none"
    for name, form in (("velocity", "{:.2f}"), ("power", "dB"), ("snr", "dB")):
        parts = [getattr(cloud, name) for cloud in clouds]
        if any(part is None for part in parts):
            found[name] = "none"
            continue
        whole = np.concatenate(parts)
        if form == "dB":
            whole, form = 10 * np.log10(np.maximum(whole, 1e-30)), "{:.1f} dB"
        found[f"{name} (m/s)" if name == "velocity" else name] = _span(whole, form)
    if (fits := static_fits(clouds)) is not None:
        share, speed, ahead = fits
        found["static world"] = f"explains {share:.0%} of the velocities"
        found["speed (m/s)"] = f"{speed:.2f}, forward {ahead:.2f}"
    return found


def static_fits(
    clouds: "list[PointCloud]",
) -> tuple[float, float, float] | None:
    """Return the share of velocities that a static world explains, and the radar's own.

    Its speed, and the part of it that is forward, are medians over the clouds with
    points enough, as the share is. None without any.
    """
    found = [fit for cloud in clouds if (fit := _static_fit(cloud)) is not None]
    return tuple(np.median(found, axis=0).tolist()) if found else None


def _static_fit(cloud: "PointCloud") -> tuple[float, float, float] | None:
    """Return the share of inliers of v = -u . ego, ego's norm and its forward part."""
    if cloud.velocity is None or len(cloud.valid) < LEAST_POINTS:
        return None
    if not np.any(cloud.velocity):  # which any world explains
        return None
    xyz, velocity = np.asarray(cloud.xyz, float), np.asarray(cloud.velocity, float)
    axes = 3 if xyz[:, 2].any() else 2
    unit = -(xyz / np.linalg.norm(xyz, axis=1, keepdims=True))[:, :axes]
    rng, best = np.random.default_rng(0), np.zeros(len(unit), bool)
    for _ in range(HYPOTHESES):
        picked = rng.choice(len(unit), axes, replace=False)
        ego = np.linalg.lstsq(unit[picked], velocity[picked], rcond=None)[0]
        inliers = abs(unit @ ego - velocity) < STATIC_MPS
        best = inliers if inliers.sum() > best.sum() else best
    ego = np.linalg.lstsq(unit[best], velocity[best], rcond=None)[0]
    return float(best.mean()), float(np.linalg.norm(ego)), float(ego[0])


def _backwards(clouds: "list[PointCloud]") -> tuple[str, ...]:
    """Return a note if a static world has the radar drive backwards."""
    fits = static_fits(clouds)
    if fits is None or fits[0] < LEAST_SHARE or fits[2] > -BACKWARDS_MPS:
        return ()
    return (
        f"by its velocities the radar moves backwards at {-fits[2]:.1f} m/s: if it "
        "drove forward, they are positive when a target approaches, expected when it "
        "recedes",
    )


def _span(values: np.ndarray, form: str = "{:.0f}") -> str:
    return f"{form.format(values.min())} to {form.format(values.max())}"
