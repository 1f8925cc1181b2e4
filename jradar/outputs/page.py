"""One HTML file with tables, pictures and point clouds, which needs no network.

    write_page("report.html", title="smoke", tables={"Scores": table}, figures={},
               frames=[CloudFrame("frame 0", {"radar": xyz, "LiDAR": truth})])

The template `page.html` draws points on a canvas without a library. Clouds are stored
as deflated int16 millimetres, and a byte for each point's confidence. If the file would
be larger than allowed, the largest clouds are thinned, and the legend shows how many
points are drawn. Where a cloud has confidence, the page colours by it, and hides points
of less than a chosen confidence. The first table is open, the other tables and the
pictures are folded. The address takes
`#frame=3&layout=side&colour=confidence&least=0.5&hide=radar,LiDAR&theme=dark`.
"""

import base64
import html
import itertools
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from jradar.files import write_text
from jradar.viz.results import Points

TEMPLATE = Path(__file__).with_name("page.html")
SHADES = np.linspace(0.07, 0.96, 256)  # of turbo, visible in both themes
POINT_PX = (1.6, 4.0)  # for clouds with many points, with few
SURE = 200  # the byte of confidence 1: percents and eighths are whole numbers


class CloudFrame(NamedTuple):
    """Clouds of one frame by name, and the printed scores of each."""

    name: str
    clouds: Mapping[str, Points]  # finite, metres
    scores: Mapping[str, Mapping[str, str]] = {}  # {"jradar": {"CD (m)": "0.41"}}


def write_page(
    path: Path | str,
    *,
    title: str,
    tables: Mapping[str, str],
    figures: Mapping[str, Path],
    frames: Sequence[CloudFrame],
    summary: str = "",
    opens_with: Sequence[str] = (),
    max_bytes: int = 5_000_000,
) -> None:
    """Write a page of a summary, clouds, Markdown tables and pictures (PNG).

    The page opens with the clouds of `opens_with` side by side, or with all of them in
    one panel. Raises ValueError if tables and pictures alone are larger than
    `max_bytes`.
    """
    parts = {name: _table(text) for name, text in tables.items()}
    parts |= {name: _picture(name, figure) for name, figure in figures.items()}
    sections = [
        f"<details{'' if i else ' open'}><summary>{html.escape(name)}</summary>\n"
        f"{part}</details>"
        for i, (name, part) in enumerate(parts.items())
    ]
    head = {"title": title, "summary": summary}
    page = TEMPLATE.read_text(encoding="utf-8")
    most = max((len(x) for f in frames for x in f.clouds.values()), default=0)
    while True:
        data = _viewer_data(frames, most) | {"shown": [*opens_with]}
        text, size_of_clouds = _page(page, head, sections, data)
        excess = len(text.encode()) - max_bytes
        if excess <= 0:
            return write_text(path, text)
        share = 0.97 * (1 - excess / max(size_of_clouds, 1))
        if share * most < 100:
            raise ValueError(
                f"a page of {excess + max_bytes:,} bytes, {size_of_clouds:,} of them "
                f"clouds, expected at most {max_bytes:,}: leave out pictures or frames"
            )
        most = int(share * most)


def _page(page, head, sections, data):
    """Return the page with its parts filled in, and the size of its clouds in bytes."""
    parts = {name: _inline(text) for name, text in head.items()} | {
        "sections": "\n".join(sections),
        "data": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        "grid": f"{data['grid_m']:g}",
    }
    text = re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], page)
    return text, sum(len(frame["data"]) for frame in data["frames"])


def _viewer_data(frames, most):
    """Return the data of the page's script, with at most `most` points per cloud."""
    names = [*dict.fromkeys(name for frame in frames for name in frame.clouds)]
    every_score = (scores for frame in frames for scores in frame.scores.values())
    labels = [*dict.fromkeys(label for scores in every_score for label in scores)]
    clouds = [[_points(frame, name) for name in names] for frame in frames]
    positions = [x[:, :3] for row in clouds for x in row]
    every = np.concatenate([*positions, np.zeros((1, 3))])
    low, near, far, high = np.percentile(every, (1, 4, 96, 99), axis=0)
    reach = float(np.abs(every).max())
    unit = max(1e-3, reach / 32767)
    packed = [[_thin(x, most) for x in row] for row in clouds]
    return {
        "names": names,
        "colours": [to_hex(f"C{i % 10}") for i in range(len(names))],
        "point_px": [
            float(np.clip(110 / np.sqrt(np.mean(counts) + 1), *POINT_PX))
            for counts in zip(*(map(len, row) for row in clouds), strict=True)
        ],
        "turbo": "".join(to_hex(colour)[1:] for colour in colormaps["turbo"](SHADES)),
        "unit_m": unit,
        "sure": SURE,
        "heights_m": [float(low[2]), float(max(high[2], low[2] + 0.1))],
        "centre_m": [float(x) for x in (near + far) / 2],
        "radius_m": float(np.linalg.norm(far - near) / 2) or 1.0,
        "reach_m": float(max(np.abs([low[:2], high[:2]]).max(), 1.0)),
        "grid_m": 1 if reach < 20 else 5,
        "scores": labels,
        "frames": [
            {
                "name": frame.name,
                "total": [len(x) for x in row],
                "drawn": [len(x) for x in thinned],
                "confident": [x.shape[1] == 4 for x in thinned],
                "scores": [
                    [frame.scores.get(name, {}).get(label) for label in labels]
                    for name in names
                ],
                "data": _pack(thinned, unit),
            }
            for frame, row, thinned in zip(frames, clouds, packed, strict=True)
        ],
    }


def checked_points(points: np.ndarray, name: str) -> np.ndarray:
    """Return the points. Raises ValueError unless they are finite `Points`."""
    columns = points.shape[1] if points.ndim == 2 else 0
    if columns not in (3, 4) or not np.isfinite(points).all():
        raise ValueError(
            f"{name} has shape {points.shape}, expected finite points [point, 3] or "
            "[point, 4]"
        )
    confidence = points[:, 3:]
    if ((confidence < 0) | (confidence > 1)).any():
        raise ValueError(
            f"{name} has confidences of {confidence.min():g} to "
            f"{confidence.max():g}, expected 0 to 1"
        )
    return points


def _points(frame: CloudFrame, name: str) -> np.ndarray:
    """Return a frame's cloud by name, empty if the frame lacks it."""
    points = np.asarray(frame.clouds.get(name, np.zeros((0, 3))), np.float64)
    return checked_points(points, f"{name} of {frame.name}")


def _thin(points, most):
    """Return at most `most` points, evenly spaced in order."""
    if len(points) <= most:
        return points
    return points[np.linspace(0, len(points) - 1, most).round().astype(int)]


def _pack(clouds: Sequence[np.ndarray], unit_m: float) -> str:
    """Return base64 of the deflated int16 steps along a Z-order curve of the points.

    The low bytes of each axis come first. A byte for each point's confidence follows.
    """
    planes = []
    for points in clouds:
        whole = np.rint(points[:, :3] / unit_m).astype(np.int64)
        order = np.argsort(_z_order(whole), kind="stable")
        steps = np.diff(whole[order], axis=0, prepend=0).astype(np.int16)
        for axis in steps.T:
            octets = axis.astype("<i2").view(np.uint8).reshape(-1, 2)
            planes += [octets[:, 0].tobytes(), octets[:, 1].tobytes()]
        confidence = np.rint(SURE * points[order, 3:]).astype(np.uint8)
        planes.append(confidence.tobytes())
    return base64.b64encode(zlib.compress(b"".join(planes))).decode()


def _z_order(whole):
    """Return the places of integer points along a Z-order curve."""
    code = np.zeros(len(whole), np.int64)
    for bit in range(16):
        for axis in range(3):
            code |= ((whole[:, axis] + 32768) >> bit & 1) << (3 * bit + axis)
    return code


def _picture(name: str, path: Path) -> str:
    png = path.read_bytes()
    if not png.startswith(b"\x89PNG"):
        raise ValueError(f"{name}: expected a PNG picture, found {png[:4]!r}")
    label, source = html.escape(name), base64.b64encode(png).decode()
    image = f'<img alt="{label}" src="data:image/png;base64,{source}">'
    return f"<figure>{image}</figure>"


def _table(text: str) -> str:
    """Return Markdown tables; other lines become paragraphs."""
    parts: list[str] = []
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for is_table, group in itertools.groupby(lines, lambda line: line.startswith("|")):
        if is_table:
            rows = [re.split(r"\s*(?<!\\)\|\s*", line)[1:-1] for line in group]
            parts.append(_rows([row for row in rows if not _is_rule(row)]))
        else:
            parts += [f"<p class='hint'>{_inline(line)}</p>" for line in group]
    return "\n".join(parts)


def _is_rule(cells: list[str]) -> bool:
    return all(re.fullmatch(r":?-+:?", cell) for cell in cells)


def _rows(lines: list[list[str]]) -> str:
    text = ""
    for i, line in enumerate(lines):
        mark = "td" if i else "th"
        cells = "".join(f"<{mark}>{_inline(cell)}</{mark}>" for cell in line)
        text += f"<tr>{cells}</tr>"
    return f"<div class='scroll'><table>{text}</table></div>"


def _inline(text: str) -> str:
    """Return a text as HTML, with Markdown's bold."""
    text = html.escape(text.replace("\\|", "|"))
    return re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
