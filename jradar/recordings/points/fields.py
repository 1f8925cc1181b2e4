"""Which field of a driver is what, and its points along jradar's axes.

    columns by name  --match-->  fields  --Layout.of-->  Layout  --cloud-->  PointCloud

Names are compared in small letters. Powers and SNRs in dB become ratios. Three things
that files do not say are read from some of the points: whether powers are in dB,
whether x or y points forward, and what is odd.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

import jradar

if TYPE_CHECKING:
    from jradar import PointCloud

Columns = Mapping[str, np.ndarray]
XYZ, POLAR = ("x", "y", "z"), ("range", "azimuth", "elevation")
NAMES = {
    "x": ("x", "posx", "xpos", "pos_x", "x_pos", "px", "x_m"),
    "y": ("y", "posy", "ypos", "pos_y", "y_pos", "py", "y_m"),
    "z": ("z", "posz", "zpos", "pos_z", "z_pos", "pz", "z_m"),
    "range": ("range", "distance", "dist", "r", "range_m"),
    "azimuth": ("azimuth", "bearing", "az", "azang", "azimuth_angle", "azimuth_deg"),
    "elevation": ("elevation", "el", "elang", "elevation_angle", "elevation_deg"),
    "velocity": (
        *("velocity", "doppler", "doppler_velocity", "doppler_mps", "v_doppler_mps"),
        *("radial_speed", "radial_velocity", "range_rate", "vel", "v", "v_r", "vr"),
        *("vrel", "vrelrad", "v_rel", "velocity_mps", "rangerate"),
    ),
    "snr": ("snr", "snr_db", "snrdb"),
    "power": (
        *("power", "power_db", "rcs", "amplitude", "magnitude", "mag"),
        *("intensity", "peak", "peak_val", "peakval"),
    ),
}
RADAR_ONLY = ("velocity", "snr", "power")  # of which one shows that a radar measured
OURS = "confidence"  # of the clouds that jradar draws: not what a radar measured
FORWARD = {  # the rows are forward, left and up, in the axes of the file
    "x": np.eye(3),
    "y": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "z": np.array([[0.0, 0, 1], [-1, 0, 0], [0, 1, 0]]),
}
AXES = {
    "x": "x forward, y left, z up",
    "y": "x right, y forward, z up",
    "z": "x right, y up, z forward",
}
AHEAD, ASIDE = 0.98, (0.02, 0.9)  # share of positive numbers on an axis
FEW = 20  # points, of which nothing follows
MOST_DB = 200.0  # a larger number is not in dB
MOST_RADAR_POINTS = 30_000  # a larger frame is a LiDAR's, or of many frames
FARTHEST_M = 1000.0  # median range; a larger one is in another unit


def match_fields(names: Collection[str]) -> dict[str, str]:
    """Return the column of each quantity that is known by its name, {"snr": "SNR"}."""
    plain = {re.sub(r"[^a-z0-9]+", "_", n.lower()).strip("_"): n for n in names}
    found = {}
    for quantity, known in NAMES.items():
        if name := next((plain[n] for n in known if n in plain), None):
            found[quantity] = name
    return found


def are_points(fields: Collection[str]) -> bool:
    """Whether these quantities place a point: x y z, or range and azimuth."""
    return {*XYZ} <= {*fields} or {*POLAR[:2]} <= {*fields}


def are_radar_points(names: Collection[str]) -> bool:
    """Whether columns of these names are of a radar, and of no other sensor."""
    fields, plain = match_fields(names), {name.lower() for name in names}
    measured = any(name in fields for name in RADAR_ONLY)
    lidar = fields.get("power", "").lower() == "intensity" and not (
        {"velocity", "snr"} & {*fields}
    )
    return are_points(fields) and measured and not lidar and OURS not in plain


class Layout(NamedTuple):
    """How points come out of columns."""

    fields: Mapping[str, str]  # columns by quantity
    forward: str = "x"  # the axis of the file that points forward
    decibels: Collection[str] = ()  # of "power" and "snr"
    degrees: bool = False  # of azimuths and elevations
    approaching: bool = False  # velocities are positive when the target approaches

    @classmethod
    def of(
        cls,
        fields: Mapping[str, str],
        seen: Sequence[Columns],
        *,
        forward: str | None = None,
        decibels: Collection[str] | None = None,
        approaching: bool = False,
    ) -> "Layout":
        """Return the layout of columns of which some frames are `seen`.

        `forward` is the axis that points forward, and `decibels` are those of "power"
        and "snr" that are in dB, if the format says so.
        """

        def all_of(quantity):
            column = fields.get(quantity, "")
            parts = [np.ravel(frame[column]) for frame in seen if column in frame]
            whole = np.concatenate([np.zeros(0), *parts])
            return whole[np.isfinite(whole)]

        if decibels is None:
            levels = {q: abs(all_of(q)).max(initial=0) for q in ("power", "snr")}
            decibels = [q for q, level in levels.items() if level <= MOST_DB]
        angles = [all_of(q) for q in POLAR[1:]]
        degrees = any(abs(angle).max(initial=0) > np.pi for angle in angles)
        if forward is None:
            forward = "x" if "x" not in fields else _forward(*map(all_of, XYZ))
        return cls(fields, forward, decibels, degrees, approaching)

    def cloud(self, columns: Columns) -> "PointCloud":
        """Return the points that are finite, as NumPy arrays."""
        xyz = self._xyz(columns)
        names = [name for name in RADAR_ONLY if name in self.fields]
        measured = {name: self._measured(name, columns, len(xyz)) for name in names}
        kept = np.isfinite(xyz).all(1) & xyz.any(1)
        if "velocity" in measured:
            kept &= np.isfinite(measured["velocity"])
        numbers = {q: column[kept] for q, column in measured.items()}
        rows: Any = xyz[kept], np.ones(kept.sum(), bool)
        return jradar.PointCloud(*rows, **numbers)

    def _xyz(self, columns: Columns) -> Float[np.ndarray, "point 3"]:
        if "x" in self.fields:
            rows = [np.ravel(columns[self.fields[q]]) for q in XYZ]
            return (np.stack(rows, -1, dtype=float) @ FORWARD[self.forward].T).astype(
                "f4"
            )
        found = [columns[self.fields[q]] for q in POLAR if q in self.fields]
        distance, *angles = (np.ravel(column).astype(float) for column in found)
        azimuth, elevation = (*map(self._radians, angles), np.zeros(len(distance)))[:2]
        ground = distance * np.cos(elevation)
        rows = ground * np.cos(azimuth), ground * np.sin(azimuth)
        return np.stack([*rows, distance * np.sin(elevation)], -1).astype("f4")

    def _radians(self, angle):
        return np.radians(angle) if self.degrees else angle

    def _measured(self, quantity, columns, count) -> Float[np.ndarray, " point"]:
        """Return a column, NaN where a frame lacks it."""
        column = columns.get(self.fields[quantity])
        if column is None:
            return np.full(count, np.nan, "f4")
        values = np.ravel(column).astype("f4")
        if quantity == "velocity":
            return -values if self.approaching else values
        return 10 ** (values / 10) if quantity in self.decibels else values

    def describe(self) -> dict[str, str]:
        """Return in words what was read from what."""
        known = [q for q in (XYZ if "x" in self.fields else POLAR) if q in self.fields]
        place = " ".join(self.fields[q] for q in known)
        unit = "degrees, " if self.degrees else "radians, "
        axes = (
            AXES[self.forward] if "x" in self.fields else f"{unit}left and up positive"
        )
        sign = "approaching" if self.approaching else "receding"
        found = {"place": f"{place} ({axes})", "velocity": "none"}
        for quantity in RADAR_ONLY:
            if quantity in self.fields:
                unit = "dB" if quantity in self.decibels else "linear"
                said = f"{sign} positive" if quantity == "velocity" else unit
                found[quantity] = f"{self.fields[quantity]} ({said})"
        return found

    def notes(self, seen: Sequence[Columns]) -> Iterator[str]:
        """Yield what is odd about the frames `seen`."""
        clouds = [self.cloud(columns) for columns in seen]
        sizes = np.array([len(cloud.valid) for cloud in clouds], int)
        given = [len(np.ravel(next(iter(columns.values())))) for columns in seen]
        if self.forward != "x":
            yield f"the points have {AXES[self.forward]}: they are rotated to x forward"
        if lost := sum(given) - sizes.sum():
            yield (
                f"{lost:,} of {sum(given):,} points are NaN or at (0, 0, 0), and are "
                "left out"
            )
        if not sizes.sum():
            yield "no frame that was looked at holds a point"
            return
        if empty := int((sizes == 0).sum()):
            yield f"{empty} of {len(sizes)} frames that were looked at are empty"
        if (most := sizes.max()) > MOST_RADAR_POINTS:
            yield (
                f"a frame holds {most:,} points: are they a LiDAR's, or of many "
                "frames? Name the radar's own topic or file"
            )
        if "velocity" not in self.fields:
            yield "the points have no Doppler velocity"
        elif not any(np.any(cloud.velocity) for cloud in clouds):
            yield "every velocity is 0: nothing moved, or the radar measured none"
        xyz = np.concatenate([np.asarray(cloud.xyz) for cloud in clouds])
        median_m = np.median(np.linalg.norm(xyz, axis=1))
        if median_m > FARTHEST_M:
            far = f"{median_m:,.0f} m"
            yield f"half of the points are beyond {far}: are they in millimetres?"
        ahead = (xyz[:, 0] > 0).mean()
        if len(xyz) >= FEW and ahead < 0.5:
            yield (
                f"{1 - ahead:.0%} of the points lie behind the radar: are they in "
                "another frame of reference than the radar's?"
            )


def _forward(*axes: Float[np.ndarray, " point"]) -> str:
    """Return the axis on which nearly all points are positive, or x if none is sure."""
    if min(map(len, axes)) < FEW:
        return "x"
    shares = {name: (axis > 0).mean() for name, axis in zip("xyz", axes, strict=True)}
    if not ASIDE[0] < shares["x"] < ASIDE[1]:
        return "x"
    return next((name for name in "yz" if shares[name] >= AHEAD), "x")
