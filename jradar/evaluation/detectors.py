"""What models are compared with: CFAR detectors, or the points that a radar sent."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np

from jradar import data
from jradar.evaluation.methods import Method
from jradar.evaluation.records import RecordsInView, points_of
from jradar.evaluation.statistics import spread
from jradar.lidar import shared_field_of_view
from jradar.metrics import f_score
from jradar.radar import DETECTORS, Radar, cell_points, detect
from jradar.range_image import ImageSpec
from jradar.types import PointCloud

RATES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  # false-alarm rates to choose from
FRAMES = 48  # that the choice is made on
SMEAR_M = 0.2  # the deviation of a smeared point in each coordinate
OWN_POINTS = "radar points"  # the method of the points that a radar sent
Choice = TypeVar("Choice")


def detector_methods(view: RecordsInView, rates: dict[str, float]) -> dict[str, Method]:
    """Return a method for each CFAR detector, at its false-alarm rate, and `splat`.

    `splat` smears the points of the last detector. A model that scores below it adds
    nothing to the radar's points.
    """

    def method(**options) -> Method:
        return lambda key, frame: detected(frame.prepared, view, **options)

    found = {
        f"{detector.upper()}-CFAR": method(detector=detector, rate=rate)
        for detector, rate in rates.items()
    }
    return _with_splat(found, view)


def point_methods(view: RecordsInView) -> dict[str, Method]:
    """Return the points that a radar sent, in the field of view, and their `splat`."""

    def method(_key, frame):
        return _in_view(frame.prepared.radar, view)

    return _with_splat({OWN_POINTS: method}, view)


def _with_splat(methods: dict[str, Method], view: RecordsInView) -> dict[str, Method]:
    if not methods:
        return {}
    last = [*methods.values()][-1]
    return methods | {
        "splat": lambda key, frame: smeared(key, last(key, frame), view.fine)
    }


def smeared(key: jax.Array, cloud: PointCloud, image: ImageSpec) -> PointCloud:
    """Return a cloud's points smeared by SMEAR_M, one for each pixel of the image.

    A model draws about as many. Points outside the field of view are not valid.
    """
    xyz, (rows, columns) = points_of(cloud), image.shape
    if not len(xyz):
        return cloud
    random = np.random.default_rng(np.asarray(jax.random.key_data(key)))
    index = random.integers(len(xyz), size=rows * columns)
    moved: Any = random.normal(xyz[index], SMEAR_M)
    seen: Any = in_view(moved, image)
    return PointCloud(moved, seen)


def in_view(xyz: np.ndarray, image: ImageSpec) -> np.ndarray:
    """Return which points lie in the field of view."""
    return shared_field_of_view(
        xyz,
        azimuth=image.azimuth,
        elevation=image.elevation,
        max_range_m=image.max_range_m,
    )


def detected(
    prepared: data.PreparedFrame, view: RecordsInView, *, detector: str, rate: float
) -> PointCloud:
    """Return the points that a detector finds in the field of view.

    Raises UsageError for a frame of points that the radar sent.
    """
    radar = view.radar_of(prepared)
    points = view.points(prepared, detector=detector, false_alarm_rate=rate)
    mask = detect(data.cells_of(prepared).power, radar, points=points)
    return seen_points(prepared, mask, view)


def seen_points(
    prepared: data.PreparedFrame, mask: Any, view: RecordsInView
) -> PointCloud:
    """Return the points of the cells in `mask` that lie in the field of view."""
    radar = Radar(view.radar_of(prepared), range_bias_m=prepared.range_bias_m)
    cells, points = data.cells_of(prepared), view.points(prepared)
    return _in_view(cell_points(cells, mask, radar, points=points), view)


def _in_view(cloud: PointCloud, view: RecordsInView) -> PointCloud:
    seen = in_view(np.asarray(cloud.xyz), view.fine)
    return cloud._replace(valid=np.asarray(cloud.valid) & seen)


def choose_rates(
    view: RecordsInView,
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
    truths = [np.asarray(frame.lidar_xyz) for frame in frames]
    scores = [
        float(np.mean([*map(f_score, map(points_of, clouds_at(choice)), truths)]))
        for choice in choices
    ]
    best = int(np.argmax(scores))
    return choices[best], scores[best]
