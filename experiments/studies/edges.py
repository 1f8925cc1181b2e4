r"""What do answers for each pixel alone lose at edges and on thin things?

    python -m experiments.studies.edges -o runs/edges \
        --records runs/smoke/data/records --model jradar-sim \
        --model jradar-sim-diffusion

A model of one pass decides every pixel alone; a draw decides all of them together. Each
model is scored on the pixels of the LiDAR's range image, in three places:

edges      within 2 pixels of a jump of the LiDAR's range by more than 0.5 m
thin       in a piece of a row of fewer than 4 pixels that stands in front of what
           is left and right of it
interior   all others

A pixel is right within 0.2 m of the LiDAR's range. A point is flying if it is more than
0.5 m from every point of the LiDAR. A diffusion model answers with one draw, and with
what 8 draws agree on. `edges.md` has the table, `edges.png` three frames.
"""

import sys
from argparse import Namespace
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from experiments.tables import markdown_table
from jradar import data, viz
from jradar.errors import UsageError
from jradar.files import write_text
from jradar.model import Model, draw, load_model
from jradar.progress import progress
from jradar.range_image import ImageSpec, unproject

KEY = 22
JUMP_M, NEAR_PIXELS, NARROW_PIXELS = 0.5, 2, 4
RIGHT_M, FLYING_M = 0.2, 0.5
SHOWN = 3  # frames in the picture
PLACES = ("edges", "thin", "interior")

Image = Float[np.ndarray, "row column"]
Answer = Callable[[jax.Array, Float[np.ndarray, "row column channel"]], Image]


class Counts(NamedTuple):
    """Pixels of the LiDAR and points of an answer, summed over frames."""

    pixels: Float[np.ndarray, " place"]
    answered: Float[np.ndarray, " place"]
    right: Float[np.ndarray, " place"]
    points: float
    flying: float


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("edges", __doc__)
    several = {"action": "append", "required": True}
    parser.add_argument("--records", required=True, help="folder of `jradar prepare`")
    parser.add_argument("--split", default="test", help="split of the records")
    parser.add_argument(
        "--model", **several, help="shipped model, or a folder; can be repeated"
    )
    parser.add_argument("--every", type=int, default=1, help="score every n-th frame")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Score all answers, and write the table and the picture."""
    if options.every < 1:
        raise UsageError(f"--every {options.every}, expected 1 or more")
    records = data.Records(options.records, options.split)
    chosen = [
        i for i in range(0, len(records), options.every) if len(records[i].lidar_xyz)
    ]
    if not chosen:
        raise UsageError(f"{options.records} has no frames with LiDAR points")
    shown = [chosen[i] for i in np.linspace(0, len(chosen) - 1, SHOWN + 2, dtype=int)]
    shown = shown[1:-1]
    found, pictures, view = {}, {}, None
    for name in options.model:
        model = load_model(name)
        pairs = build_pairs(model.spec, records)
        view = view or model.spec.fine
        for label, answer in answers(name, model).items():
            counts = []
            with progress(f"scoring {label}", len(chosen), unit="frames") as show:
                for done, i in enumerate(chosen, 1):
                    pair = pairs[i]
                    key = jax.random.fold_in(jax.random.key(KEY), i)
                    image = answer(key, pair.condition)
                    truth, xyz = np.asarray(pair.lidar), records[i].lidar_xyz
                    counts.append(counted(image, truth, xyz, model.spec.fine))
                    if i in shown:
                        pictures.setdefault(i, {"LiDAR": truth})[label] = image
                    show(done)
            found[label] = Counts(*(sum(parts) for parts in zip(*counts, strict=True)))
    text = table(found, len(chosen))
    write_text(options.output / "edges.md", text)
    viz.save_figure(
        figure([pictures[i] for i in shown], view), options.output / "edges.png"
    )
    print(f"{text}\nwritten to {options.output}")


def answers(name: str, model: Model) -> dict[str, Answer]:
    """Return how a model answers, by what that is called in the table."""

    def answering(**drawing):
        return lambda key, condition: np.asarray(
            draw(key, jnp.asarray(condition), model, **drawing).range_m
        )

    if model.spec.method != "diffusion":
        return {f"{name}, one pass": answering()}
    return {
        f"{name}, one draw": answering(draws=1),
        f"{name}, 8 draws": answering(draws=8),
    }


def places(truth: Image) -> Bool[np.ndarray, "place row column"]:
    """Return which pixels of a LiDAR's image lie in each of PLACES."""
    seen = truth > 0
    size = 2 * NEAR_PIXELS + 1
    far = maximum_filter(np.where(seen, truth, -np.inf), size, mode="nearest")
    near = minimum_filter(np.where(seen, truth, np.inf), size, mode="nearest")
    with np.errstate(invalid="ignore"):
        edge = seen & (far - near > JUMP_M)
    narrow = thin(truth)
    return np.stack([edge & ~narrow, narrow, seen & ~edge & ~narrow])


def thin(truth: Image) -> Bool[np.ndarray, "row column"]:
    """Return the pixels of narrow pieces of rows in front of what is beside them.

    Pixels that the LiDAR missed are unknown: its next pixels to both sides count.
    """
    found = np.zeros(truth.shape, bool)
    for row, marked in zip(truth, found, strict=True):
        columns = np.flatnonzero(row)
        depth = row[columns]
        cuts = np.flatnonzero(np.abs(np.diff(depth)) > JUMP_M) + 1
        for first, end in zip(cuts[:-1], cuts[1:], strict=True):  # not at the rim
            width = columns[end - 1] - columns[first] + 1
            in_front = depth[first] < depth[first - 1] and depth[end - 1] < depth[end]
            if width < NARROW_PIXELS and in_front:
                marked[columns[first:end]] = True
    return found


def counted(
    image: Image, truth: Image, lidar_xyz: Float[np.ndarray, "point 3"], view: ImageSpec
) -> Counts:
    """Return the counts of one frame."""
    where = places(truth)
    answered = where & (image > 0)
    right = answered & (np.abs(image - truth) <= RIGHT_M)
    cloud = unproject(jnp.asarray(image), view)
    xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    away = cKDTree(lidar_xyz).query(xyz, distance_upper_bound=FLYING_M)[0]
    sums = (part.sum((1, 2)).astype(float) for part in (where, answered, right))
    return Counts(*sums, float(len(xyz)), float((away > FLYING_M).sum()))


def table(found: dict[str, Counts], frames: int) -> str:
    """Return Markdown: a row for each answer."""
    titles = ["answer"]
    titles += [f"{place}: right (%)" for place in PLACES]
    titles += [f"{place}: right of the answered (%)" for place in PLACES]
    titles += ["points a frame", "flying (%)"]
    lines = []
    for label, counts in found.items():
        shares = np.concatenate(
            [counts.right / counts.pixels, counts.right / counts.answered]
        )
        flying = 100 * counts.flying / max(counts.points, 1.0)
        cells = [f"{100 * share:.1f}" for share in shares]
        lines.append([label, *cells, f"{counts.points / frames:,.0f}", f"{flying:.1f}"])
    pixels = next(iter(found.values())).pixels / frames
    which = ", ".join(f"{n:,.0f} {p}" for p, n in zip(PLACES, pixels, strict=True))
    return f"{frames} frames; LiDAR pixels a frame: {which}.\n\n" + markdown_table(
        titles, lines
    )


def figure(frames: Sequence[dict[str, Image]], view: ImageSpec) -> Figure:
    """Draw range images, left at the left, and below them the clouds from above."""
    columns = [*frames[0]]
    drawing = Figure((3 * len(columns), 2.8 * len(frames)), layout="constrained")
    grid = drawing.subplots(
        2 * len(frames),
        len(columns),
        squeeze=False,
        height_ratios=[1, 2] * len(frames),
    )
    for place, images in enumerate(frames):
        for column, label in enumerate(columns):
            above, below = grid[2 * place][column], grid[2 * place + 1][column]
            shown = np.where(images[label] > 0, images[label], np.nan)[:, ::-1]
            above.imshow(shown, vmin=0, vmax=view.max_range_m, aspect="auto")
            above.set(xticks=[], yticks=[], title="" if place else label)
            cloud = unproject(jnp.asarray(images[label]), view)
            x, y, z = np.asarray(cloud.xyz)[np.asarray(cloud.valid)].T
            colours = {"c": z, "vmin": -1.5, "vmax": 1.5, "cmap": "turbo"}
            below.scatter(y, x, s=0.5, linewidths=0, **colours)
            reach = view.max_range_m
            below.set(xlim=(reach, -reach), ylim=(0, reach), aspect="equal")
    return drawing


if __name__ == "__main__":
    sys.exit(main())
