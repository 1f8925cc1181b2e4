"""CFAR detectors on records: the methods that every model is compared with."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from experiments.evaluate import View, points_of, spread
from jradar import data
from jradar.evaluation import Method, score_points
from jradar.lidar import shared_field_of_view
from jradar.radar import DETECTORS, Radar, cell_points, detect
from jradar.types import PointCloud

RATES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  # false-alarm rates to choose from
FRAMES = 48  # that the choice is made on
Choice = TypeVar("Choice")


def detector_methods(view: View, rates: dict[str, float]) -> dict[str, Method]:
    """Return a method for each CFAR detector, at its false-alarm rate."""

    def method(**options) -> Method:
        return lambda key, frame: detected(frame.prepared, view, **options)

    return {
        f"{detector.upper()}-CFAR": method(detector=detector, rate=rate)
        for detector, rate in rates.items()
    }


def detected(
    prepared: data.PreparedFrame, view: View, *, detector: str, rate: float
) -> PointCloud:
    """Return the points that a detector finds in the field of view."""
    radar = view.radar_of(prepared)
    points = view.points(prepared, detector=detector, false_alarm_rate=rate)
    mask = detect(prepared.cells.power, radar, points=points)
    return seen_points(prepared, mask, view)


def seen_points(prepared: data.PreparedFrame, mask: Any, view: View) -> PointCloud:
    """Return the points of the cells in `mask` that lie in the field of view."""
    radar = Radar(view.radar_of(prepared), range_bias_m=prepared.range_bias_m)
    cloud = cell_points(prepared.cells, mask, radar, points=view.points(prepared))
    seen = shared_field_of_view(
        np.asarray(cloud.xyz),
        azimuth=view.fine.azimuth,
        elevation=view.fine.elevation,
        max_range_m=view.fine.max_range_m,
    )
    return cloud._replace(valid=np.asarray(cloud.valid) & seen)


def choose_rates(
    view: View,
    records: data.Records,
    *,
    detectors: Sequence[str] = tuple(DETECTORS),
    frames: int = FRAMES,
) -> dict[str, float]:
    """Return the false-alarm rate at which each detector has its best F-score."""
    prepared = [records[i] for i in spread(len(records), frames)]

    def best_rate(detector):
        def clouds_at(rate):
            return [detected(f, view, detector=detector, rate=rate) for f in prepared]

        return best_choice(RATES, prepared, clouds_at)[0]

    return {detector: best_rate(detector) for detector in detectors}


def best_choice(
    choices: Sequence[Choice],
    frames: Sequence[data.PreparedFrame],
    clouds_at: Callable[[Choice], Sequence[PointCloud]],
) -> tuple[Choice, float]:
    """Return the choice with the best mean F-score at 0.2 m, and that score.

    `clouds_at(choice)` are the frames' clouds. Among equals, the first choice wins.
    """
    scores = [
        float(np.mean([*map(f_score, clouds_at(choice), frames)])) for choice in choices
    ]
    best = int(np.argmax(scores))
    return choices[best], scores[best]


def f_score(cloud: PointCloud, prepared: data.PreparedFrame) -> float:
    """Return the F-score at 0.2 m against a frame's LiDAR; 0 if one has no points."""
    scores = score_points(points_of(cloud), prepared.lidar_xyz)
    return float(np.nan_to_num(scores["f_score_0.2"]))
