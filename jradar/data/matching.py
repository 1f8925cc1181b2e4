"""Match radar frames and LiDAR scans by their time stamps (section V-A)."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

MAX_DROPPED = 0.5  # largest fraction of radar frames that may be dropped


class Matches(NamedTuple):
    """Matched radar frames in rising order, and why the others were dropped."""

    radar: Int[np.ndarray, " match"]
    lidar: Int[np.ndarray, " match"]
    dropped: dict[int, str]  # radar frame: reason


def match_nearest(
    radar_stamps: Float[np.ndarray, " radar"],
    lidar_stamps: Float[np.ndarray, " lidar"],
    *,
    tolerance_s: float = 0.05,
    span: tuple[float, float] = (-np.inf, np.inf),
) -> Matches:
    """Match each radar frame with the nearest LiDAR scan, on the host.

    A scan is used once: the closest pairs are matched first. Frames without a scan
    within `tolerance_s` and frames outside `span` (start and end of the trajectory in
    seconds) are dropped. Stamps may be in any order. Raises ValueError for stamps that
    are not finite.
    """
    radar, lidar = np.asarray(radar_stamps, float), np.asarray(lidar_stamps, float)
    for name, stamps in (("radar", radar), ("LiDAR", lidar)):
        if bad := np.flatnonzero(~np.isfinite(stamps)).size:
            raise ValueError(f"{bad} of {len(stamps)} {name} stamps are not finite")
    dropped = {
        int(i): "outside the trajectory"
        for i in np.flatnonzero((radar < span[0]) | (radar > span[1]))
    }
    order = np.argsort(lidar, kind="stable")
    rising = lidar[order]
    first = np.searchsorted(rising, radar - tolerance_s)
    last = np.searchsorted(rising, radar + tolerance_s, side="right")
    candidates = sorted(
        (abs(rising[j] - radar[i]), i, int(order[j]))
        for i in range(len(radar))
        if i not in dropped
        for j in range(first[i], last[i])
    )
    partner: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in partner and j not in taken:
            partner[i] = j
            taken.add(j)
    near = {i for _, i, _ in candidates}
    for i in range(len(radar)):
        if i not in partner and i not in dropped:
            dropped[i] = (
                "its LiDAR scan is closer to another radar frame"
                if i in near
                else f"no LiDAR scan within {1e3 * tolerance_s:g} ms"
            )
    frames = np.array(sorted(partner), int)
    scans = np.array([partner[i] for i in frames], int)
    return Matches(frames, scans, dict(sorted(dropped.items())))


def check_dropped(name: str, num_frames: int, dropped: dict[int, str]) -> None:
    """Raise ValueError with the reasons if more than half of the frames are dropped."""
    if len(dropped) > MAX_DROPPED * num_frames:
        reasons = list(dropped.values())
        counts = ", ".join(f"{reasons.count(r)} {r}" for r in dict.fromkeys(reasons))
        raise ValueError(
            f"{name}: {len(dropped)} of {num_frames} radar frames are dropped "
            f"({counts}), expected at most half: do the two clocks agree?"
        )
