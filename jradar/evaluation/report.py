"""A run's report, built from the files of its evaluation.

    RUN/metrics.jsonl                 learning curves
    RUN/evaluation/frames.jsonl       scores: tables, error curves
    RUN/evaluation/clouds.npz         clouds of a few frames
    RUN/evaluation/about.txt          the first sentence: what the frames are
    RUN/evaluation/*.png              pictures
    RUN/evaluation/report.html        all of them in one file

Only the scores are required. The pictures that the report draws are written next to it:
curves.png (Fig. 6), clouds.png (Fig. 5) and training.png. Each cloud is written as
clouds/SEQUENCE_FRAME/NAME.ply.

A cloud is an array `[point, 3]` of x, y, z in metres, or `[point, 4]` with the
confidence of each point, 0 to 1, as its fourth column: the page says which share of
such a cloud may be right.
"""

import json
import re
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from jradar.errors import parsing
from jradar.evaluation.scores import Scores, read_scores
from jradar.evaluation.statistics import compare_methods
from jradar.evaluation.tables import (
    COLUMNS,
    IN_SCENES,
    markdown,
    paper_tables,
    pooled_table,
    summarise,
)
from jradar.files import atomic_folder, atomic_path, check_unpacked, inside
from jradar.outputs.clouds import write_ply
from jradar.outputs.page import CloudFrame, checked_points, write_page
from jradar.range_image import UNSURE
from jradar.types import PointCloud
from jradar.viz import learning_curve_figure, save_figure
from jradar.viz.results import clouds_figure, error_curves_figure

MAX_CLOUD_BYTES = 1 << 30
CLOUDS_NOTE = "clouds.txt"  # marks the folder of clouds as written here
MAX_REPORT_BYTES = 10_000_000
MOST_SCENES = 6  # in the figure of clouds: a page has room for few large pictures
SPARSE = 2000  # points; clouds with fewer are drawn with larger dots
DRAWN = ("curves.png", "clouds.png", "training.png")
ABOUT = "about.txt"
JUDGED = "f_score_0.2"  # the score by which a method is the best
OTHERS = ("SO-CFAR", "CA-CFAR", "GO-CFAR")


def save_clouds(
    path: Path | str, clouds: Mapping[tuple[str, str, int], Mapping[str, np.ndarray]]
) -> None:
    """Write clouds by (scene, sequence, frame) and by name, as float32.

    A cloud is `[point, 3]`, or `[point, 4]` with the confidence in the fourth column.
    """
    index, arrays = [], {}
    for (scene, sequence, frame), named in clouds.items():
        for name, points in named.items():
            arrays[f"cloud_{len(index)}"] = np.asarray(points, np.float32)
            index.append([scene, sequence, frame, name])
    with atomic_path(path) as scratch:
        np.savez_compressed(scratch, index=np.array(json.dumps(index)), **arrays)


def load_clouds(path: Path | str) -> dict[tuple[str, str, int], dict[str, np.ndarray]]:
    """Return the clouds of `save_clouds`. Raises ValueError for a damaged file."""
    clouds: dict[tuple[str, str, int], dict[str, np.ndarray]] = {}
    with parsing(path, "a file of clouds (evaluate the run again)"):
        check_unpacked(path, limit=MAX_CLOUD_BYTES)
        with np.load(path, allow_pickle=False) as arrays:
            for i, entry in enumerate(json.loads(str(arrays["index"]))):
                scene, sequence, frame, name = entry
                if [*map(type, entry)] != [str, str, int, str]:
                    raise ValueError(f"{entry} is not scene, sequence, frame and name")
                if inside("", sequence, source=path).parts[1:]:
                    raise ValueError(f"the sequence {sequence!r} is not a plain name")
                points = np.asarray(arrays[f"cloud_{i}"], np.float32)
                points = checked_points(points, f"{name} of frame {frame}")
                clouds.setdefault((scene, sequence, frame), {})[name] = points
    return clouds


def build_report(run: Path | str) -> Path:
    """Write `RUN/evaluation/report.html` and return its path.

    Raises FileNotFoundError if the run was not evaluated.
    """
    run = Path(run)
    folder = run / "evaluation"
    if not (folder / "frames.jsonl").is_file():
        raise FileNotFoundError(f"{folder / 'frames.jsonl'}: evaluate {run} first")
    scores = read_scores(folder / "frames.jsonl")
    summary = summarise(scores)
    truths = [*dict.fromkeys(row["truth"] for row in summary)]
    first = [row for row in scores if row["truth"] == truths[0]]
    tables = {f"All scenes, against {truths[0]}": pooled_table(first)}
    for truth in truths:
        parts = paper_tables(summary, truth=truth, intervals=True)
        tables[f"Scenes, against {truth}"] = "\n".join(parts)
    tables["Every score"] = markdown(summary, columns=COLUMNS)
    errors: dict[str, dict[str, list[float]]] = {}
    for row in first:
        by_method = errors.setdefault(row["scene"], {})
        if row["truth_points"]:
            by_method.setdefault(row["method"], []).append(row["chamfer"])
    drawn = {"Chamfer distance": ("curves.png", error_curves_figure(errors))}
    frames = []
    if (folder / "clouds.npz").is_file():
        clouds = load_clouds(folder / "clouds.npz")
        frames = _frames(clouds, first)
        drawn["Clouds"] = ("clouds.png", _clouds_figure(clouds))
        _write_clouds(folder / "clouds", clouds)
    metrics = run / "metrics.jsonl"  # empty after a run of no steps
    if metrics.is_file() and metrics.stat().st_size:
        drawn["Training"] = ("training.png", learning_curve_figure(metrics))
    for name, figure in drawn.values():
        save_figure(figure, folder / name)
    figures = {title: folder / name for title, (name, _) in drawn.items()}
    others = [p for p in sorted(folder.glob("*.png")) if p.name not in DRAWN]
    figures |= {path.stem: path for path in others}
    path, (best, other) = folder / "report.html", _best_and_rival(first)
    sentences = _summary(first, best, other)
    if (folder / ABOUT).is_file():
        about = (folder / ABOUT).read_text(encoding="utf-8").strip()
        sentences = f"{about} {sentences}".strip()
    write_page(
        path,
        title=f"{run.resolve().name}: {', '.join(errors)}",
        summary=sentences,
        opens_with=[other, best, truths[0]],
        tables=tables,
        figures=figures,
        frames=frames,
        max_bytes=MAX_REPORT_BYTES,
    )
    return path


def _best_and_rival(scores: Scores) -> tuple[str, str]:
    """Return the method with the best mean F-score, and the best CFAR detector.

    Without another CFAR detector, the second is the next best method, or else the same
    method.
    """
    series: dict[str, list[float]] = {}
    for row in scores:
        if row["truth_points"]:
            series.setdefault(row["method"], []).append(row[JUDGED])
    ranked = sorted(series, key=lambda name: -np.mean(series[name]))
    best, *others = ranked or [scores[0]["method"]]
    return best, next((n for n in others if "CFAR" in n), [*others, best][0])


def _summary(scores: Scores, best: str, other: str) -> str:
    """Return the best method, its lead and the frames, in one sentence."""
    rows, rivals = (
        [r for r in scores if r["method"] == name] for name in (best, other)
    )
    seen = [row for row in rows if row["truth_points"]]
    if not seen:
        return "No frame has a true point."
    mean = 100 * np.mean([row[JUDGED] for row in seen])
    text = f"**{best}** has the best F-score at 0.2 m: {mean:.1f} % on average"
    if other != best:
        found = compare_methods(rows, rivals, score=JUDGED)
        gain, low, high = (100 * value for value in found.difference[:3])
        text += f", {gain:.1f} points above {other}"
        text += f" ({low:.1f} to {high:.1f})" if np.isfinite(low) else ""
    scenes = ", ".join(dict.fromkeys(row["scene"] for row in seen))
    return f"{text}, over {len(seen)} frames of {scenes}."


def _write_clouds(folder: Path, clouds) -> None:
    """Write every cloud as PLY, replacing earlier ones."""
    with atomic_folder(folder, marker=CLOUDS_NOTE) as scratch:
        (scratch / CLOUDS_NOTE).write_text("Written with the report of a run.\n")
        for (_, sequence, frame), named in clouds.items():
            for name, points in named.items():
                file = re.sub(r"[^A-Za-z0-9.+-]+", "_", name) + ".ply"
                write_ply(scratch / f"{sequence}_{frame}" / file, _cloud(points))


def _cloud(points: Any) -> PointCloud:
    valid: Any = np.ones(len(points), bool)
    cloud = PointCloud(points[:, :3], valid)
    return cloud if points.shape[1] == 3 else cloud._replace(confidence=points[:, 3])


def open_report(run: Path | str, *, show: bool = True) -> Path:
    """Return the path of the run's report, and open it in a browser if `show`.

    A report that is missing or older than its parts is built first.
    """
    run = Path(run)
    path = run / "evaluation" / "report.html"
    parts = [run / "metrics.jsonl", *path.parent.glob("*.jsonl")]
    parts += [*path.parent.glob("*.npz"), *path.parent.glob("*.png")]
    newest = max((p.stat().st_mtime for p in parts if p.exists()), default=0.0)
    if not path.is_file() or path.stat().st_mtime < newest:
        build_report(run)
    if show:
        webbrowser.open(path.resolve().as_uri())
    return path


def _clouds_figure(clouds) -> Figure:
    """Draw the first frame of some scenes, with one detector alone as in the paper."""
    scenes: dict[str, dict[str, np.ndarray]] = {}
    for (scene, _, _), named in clouds.items():
        if scene in scenes or len(scenes) < MOST_SCENES:
            shown = {n: x for n, x in named.items() if n not in OTHERS}
            scenes.setdefault(scene, shown)
    every = [cloud for named in scenes.values() for cloud in named.items()]
    dense = {name for name, xyz in every if len(xyz) >= SPARSE}
    return clouds_figure(scenes, enlarged={name for name, _ in every} - dense)


def _frames(clouds, scores: Scores) -> list[CloudFrame]:
    texts: dict[tuple, dict[str, dict[str, str]]] = {}
    for row in scores:
        place = (row["scene"], row["sequence"], row["frame"])
        texts.setdefault(place, {})[row["method"]] = {
            COLUMNS[name].title: COLUMNS[name].text(row[name])
            for name in IN_SCENES
            if np.isfinite(row[name])
        }
    for place, named in clouds.items():
        for name, points in named.items():
            if points.shape[1] == 4 and len(points):
                sure = float(points[:, 3].mean())
                verdict = f"{sure:.0%}{'' if sure >= UNSURE else ', do not trust'}"
                methods = texts.setdefault(place, {})
                methods[name] = {"may be right": verdict, **methods.get(name, {})}
    title = {place: ", ".join(str(p) for p in place if p != "") for place in clouds}
    return [
        CloudFrame(title[place], named, texts.get(place, {}))
        for place, named in clouds.items()
    ]
