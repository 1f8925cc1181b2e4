"""What scoring found: its tables, and its report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jradar import viz
from jradar.evaluation.records import (
    TRUTH,
    Clouds,
    RecordsInView,
    samples,
    write_report,
)
from jradar.evaluation.reliability import precision_over_coverage, reliability
from jradar.evaluation.scores import Scores
from jradar.evaluation.statistics import compare_methods
from jradar.evaluation.tables import COLUMNS, pooled
from jradar.metrics import NEAR_M
from jradar.options.protocols import PAPER, PROTOCOLS as DEFINITIONS

JUDGED = "f_score_0.2"
OF_PROTOCOLS = ("modified_hausdorff", "f_score_0.1")  # further columns


class Score(NamedTuple):
    """What was scored, every score, and the clouds of some frames."""

    records: dict[str, int]  # sequences and their scored frames
    radar: str
    models: tuple[str, ...]
    rows: Scores
    rings: Scores  # by distance from the radar
    confidence: dict[str, tuple[np.ndarray, np.ndarray]]  # of points; which are right
    clouds: Clouds
    view: RecordsInView
    notes: tuple[str, ...]
    protocol: str = PAPER
    near_m: float = NEAR_M  # within which a point is right in the view

    def describe(self) -> dict[str, Any]:
        """Return the tables, in metres and percent; intervals hold 95 %."""
        found: dict[str, Any] = {
            "radar": self.radar,
            "frames": sum(self.records.values()),
            "recordings": [f"{k}: {n} frames" for k, n in self.records.items()],
            "protocol": f"{self.protocol}: {DEFINITIONS[self.protocol]}",
            "notes": list(self.notes),
        }
        more = () if self.protocol == PAPER else OF_PROTOCOLS
        for truth in dict.fromkeys(row["truth"] for row in self.rows):
            means = pooled(row for row in self.rows if row["truth"] == truth)
            found[f"against the {truth}"] = [self._line(mean, more) for mean in means]
        found["by distance"] = [
            {"distance": mean["distance"], **self._line(mean)}
            for mean in self._by_distance()
        ]
        found["compared"] = [*self._compared()]
        found["confidence"] = [
            {
                "model": name,
                "points": len(right),
                "confidence (%)": 100 * float(confidence.mean(dtype=float)),
                "right (%)": 100 * float(right.mean()),
                "calibration error (%)": 100 * reliability(confidence, right).error(),
            }
            for name, (confidence, right) in self.confidence.items()
        ]
        return found

    def _by_distance(self):
        """The means of each method in each ring with a true point, nearest first."""
        columns = {"by": ("distance", "method"), "columns": (JUDGED, "points")}
        means = [mean for mean in pooled(self.rings, **columns) if mean["frames"]]
        order = [*dict.fromkeys(row["distance"] for row in self.rings)]
        return sorted(means, key=lambda mean: order.index(mean["distance"]))

    def _compared(self):
        rows = {}
        for row in self.rows:
            if row["truth"] == TRUTH:
                rows.setdefault(row["method"], []).append(row)
        reference = self.models[0]
        for name, scores in rows.items():
            if name != reference:
                found = compare_methods(scores, rows[reference], score=JUDGED)
                yield {
                    "methods": f"{name} minus {reference}",
                    **_interval(f"F {self.near_m:g} m (points)", found.difference),
                    "p": found.t_test,
                }

    @property
    def _title(self):
        """The column of the F-score, by the distance within which points are right."""
        return f"F {self.near_m:g} m (%)"

    def _line(self, mean: dict[str, Any], more: Sequence[str] = ()) -> dict[str, Any]:
        line = {"method": mean["method"]}
        if "chamfer" in mean:
            line["CD (m)"] = mean["chamfer"].mean
        for name in more:
            line[COLUMNS[name].title] = COLUMNS[name].scale * mean[name].mean
        line |= _interval(self._title, mean[JUDGED])
        line["points"] = round(mean["points"].mean) if mean["frames"] else 0
        if "milliseconds" in mean:
            line["ms"] = mean["milliseconds"].mean
        return line | {"frames": mean["frames"], "empty": mean["empty"]}

    def write(self, folder: Path | str) -> Path:
        """Write scores, tables, pictures, clouds and a report; return its path."""
        curves: dict[str, dict[str, float]] = {}
        for mean in self._by_distance():
            curve = curves.setdefault(mean["method"], {})
            curve[mean["distance"]] = 100 * mean[JUDGED].mean
        figures = {
            "samples": samples(self.clouds, self.view.fine),
            "distance": viz.bars_figure(curves, ylabel=self._title),
        }
        if judged := self.confidence:
            bins = {name: reliability(*p).means() for name, p in judged.items()}
            kept = {name: precision_over_coverage(*p) for name, p in judged.items()}
            figures["reliability"] = viz.reliability_figure(bins, kept)
        about = ""
        if self.protocol != PAPER:
            about = f"Protocol {self.protocol}: {DEFINITIONS[self.protocol]}."
        elif self.near_m != NEAR_M:
            about = (
                f"The view is {self.near_m / NEAR_M:g} times as large as usual, and so "
                f"are the distances of F-scores: F 0.2 m means {self.near_m:g} m."
            )
        return write_report(Path(folder), self.rows, self.clouds, figures, about=about)


def _interval(title: str, estimate: Any) -> dict[str, float]:
    """Return a mean in percent with the ends of its interval."""
    values = zip((title, "from", "to"), estimate[:3], strict=True)
    return {name: 100 * value for name, value in values}
