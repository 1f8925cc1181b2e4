"""The file of scores: one JSON line for each frame, method and truth.

    {"scene": "Hallways", "sequence": "ec_hallways_run4", "frame": 17,
     "truth": "LiDAR", "method": "OS-CFAR", "points": 214, "truth_points": 30121,
     "milliseconds": 3.1, "chamfer": 2.41, "modified_hausdorff": 0.31,
     "f_score_0.1": 0.21, "f_score_0.2": 0.33, "f_score_0.5": 0.58}

Distances are in metres, F-scores from 0 to 1, and NaN is written as null. Tables,
curves and comparisons are made from this file alone. A frame in which the method found
nothing has no distances and F-scores of 0; a frame with an empty truth has no scores.
"""

import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jradar.files import write_text
from jradar.metrics import THRESHOLDS_M

Scores = list[dict[str, Any]]
IDENTITY = ("scene", "sequence", "frame", "truth", "method")
DISTANCES = ("chamfer", "modified_hausdorff")
F_SCORES = tuple(f"f_score_{limit}" for limit in THRESHOLDS_M)
COUNTS = ("points", "truth_points")
FIELDS = (*IDENTITY, *COUNTS, "milliseconds", *DISTANCES, *F_SCORES)
MAX_BYTES = 1 << 30


def write_scores(path: Path | str, scores: Iterable[dict[str, Any]]) -> None:
    """Write scores as JSON lines, in one step."""
    lines = (
        json.dumps({k: None if _is_nan(v) else v for k, v in row.items()})
        for row in scores
    )
    write_text(path, "".join(line + "\n" for line in lines))


def read_scores(path: Path | str) -> Scores:
    """Return the scores of a file of `write_scores`, null as NaN.

    Raises FileNotFoundError for a missing file, and ValueError, naming the line, for a
    field that is missing, unknown, of the wrong type or out of range, and for a frame
    that is scored twice.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no scores at {path}: evaluate the run first")
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, expected at most {MAX_BYTES:,}")
    scores: Scores = []
    seen: dict[tuple, int] = {}
    with path.open(encoding="utf-8", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            try:
                row = _checked(json.loads(line))
            except (ValueError, RecursionError) as error:
                where = f"{path}, line {number}"
                raise ValueError(f"{where}: {error}; evaluate again") from error
            identity = tuple(row[field] for field in IDENTITY)
            if (first := seen.setdefault(identity, number)) != number:
                raise ValueError(
                    f"{path}, lines {first} and {number} score the same frame: "
                    + ", ".join(map(str, identity))
                )
            scores.append(row)
    if not scores:
        raise ValueError(f"{path} holds no scores: evaluate the run first")
    return scores


def _checked(row):
    """Return the row with NaN for null, or raise ValueError."""
    if not isinstance(row, dict):
        raise ValueError(f"{row!r:.60} is not a JSON object")
    missing, unknown = set(FIELDS) - set(row), set(row) - set(FIELDS)
    if missing or unknown:
        what = "lacks" if missing else "has unknown fields"
        raise ValueError(f"{what} {', '.join(sorted(missing or unknown))}")
    for field in ("scene", "sequence", "truth", "method"):
        if not isinstance(row[field], str):
            raise ValueError(f"{field} is {row[field]!r}, expected a name")
    for field in ("frame", *COUNTS):
        if type(row[field]) is not int or row[field] < 0:
            raise ValueError(f"{field} is {row[field]!r}, expected 0 or more")
    for field in ("milliseconds", *DISTANCES, *F_SCORES):
        row[field] = _number(field, row[field])
    return {field: row[field] for field in FIELDS}


def _number(field, value):
    if value is None or _is_nan(value):
        return math.nan
    highest = 1 if field in F_SCORES else math.inf
    kind = type(value) in (int, float)
    if not kind or not 0 <= value <= highest or value > sys.float_info.max:
        raise ValueError(f"{field} is {value!r}, expected 0 .. {highest:g} or null")
    return float(value)


def _is_nan(value):
    return isinstance(value, float) and math.isnan(value)
