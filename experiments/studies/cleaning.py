r"""Measure what the two ways to clean a radar's samples give back.

    python -m experiments.studies.cleaning -o runs/cleaning --model jradar-sim

    interference    crossing chirps of other radars: with their excision and without it
    background      static clutter of a standing radar: as it is, and after the mean of
                    the recording's frames was subtracted, as `--background` does

The recordings are those of the robustness set, for the background with six frames of
each layout, of which the last is scored. The truth is the LiDAR's part that the radar
could have seen, in the second table also what of it moved: its points that are more
than 0.2 m from all of the first frame's.
"""

import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from experiments.build import prepare_spec
from experiments.command import run_study, study_parser
from experiments.configs import varied
from experiments.studies.robustness import simulated_shift
from experiments.studies.variants import (
    Truths,
    score_cells,
    score_recordings,
    truths_of,
    with_excision,
)
from experiments.tables import markdown_table
from jradar import data
from jradar.files import write_text
from jradar.model import Model, load_model
from jradar.recordings import without_background

INTERFERENCE = ("clean", "weak-interference", "strong-interference")
STANDING = ("standing-still", "clutter-standing-still")
FRAMES = 6  # of each recording of a standing radar
MOVED_M, LEAST_POINTS = 0.2, 20


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("cleaning", __doc__)
    parser.add_argument("--model", default="jradar-sim", help="to score")
    parser.add_argument(
        "--shift",
        action="append",
        choices=[*INTERFERENCE, *STANDING],
        help="only this shift",
    )
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Write both tables."""
    model = load_model(options.model)
    shifts = options.shift or [*INTERFERENCE, *STANDING]
    excised = [
        row
        for shift in shifts
        if shift in INTERFERENCE
        for row in interference_rows(model, shift, options.output / "data" / shift)
    ]
    subtracted = [
        row
        for shift in shifts
        if shift in STANDING
        for row in background_rows(model, shift, options.output / "data" / shift)
    ]
    scores = ["frames", "Chamfer (m)", "F-score (%)", "F-score, gain (points)"]
    tables = [
        markdown_table(["shift", "samples", *scores], excised),
        markdown_table(["shift", "truth", "samples", *scores], subtracted),
    ]
    write_text(options.output / "cleaning.md", text := "\n".join(tables))
    print(text)


def interference_rows(model: Model, shift: str, folder: Path) -> list[list[str]]:
    """Return the rows of a shift: without and with excision."""
    recordings = simulated_shift(folder / "recordings", shift)
    truths = truths_of(_prepared(recordings, folder / "records"))
    opened = [source.open() for source in data.find_sources(recordings)]
    before, after = (
        score_recordings(with_excision(model, wanted), opened, truths)
        for wanted in (False, True)
    )
    return [
        [shift, "as recorded", str(len(before)), *score_cells(before)],
        [shift, "excised", str(len(after)), *score_cells(after, before)],
    ]


def background_rows(model: Model, shift: str, folder: Path) -> list[list[str]]:
    """Return the rows of a standing radar: without and with its background."""
    recordings = simulated_shift(folder / "recordings", shift, frames=FRAMES)
    ends = slice(0, FRAMES, FRAMES - 1)
    clouds = truths_of(_prepared(recordings, folder / "records", frames=ends))
    last = {where: xyz for where, xyz in clouds.items() if where[1]}
    truths = {"all": last, "what moved": moved(clouds)}
    opened = [source.open() for source in data.find_sources(recordings)]
    cleaned = [without_background(recording, slice(None)) for recording in opened]
    rows = []
    for name, truth in truths.items():
        if not truth:  # nothing moved
            continue
        before, after = (
            score_recordings(with_excision(model, True), sequences, truth)
            for sequences in (opened, cleaned)
        )
        rows += [
            [shift, name, "as recorded", str(len(before)), *score_cells(before)],
            [shift, name, "subtracted", str(len(after)), *score_cells(after, before)],
        ]
    return rows


def moved(clouds: Truths) -> Truths:
    """Return the points of last frames that the sequences' first frames do not have.

    Sequences with few such points are left out.
    """
    found = {}
    for (sequence, frame), xyz in clouds.items():
        if not frame or (sequence, 0) not in clouds:
            continue
        apart, _ = KDTree(clouds[sequence, 0]).query(xyz)
        if np.sum(new := np.asarray(apart) > MOVED_M) >= LEAST_POINTS:
            found[sequence, frame] = xyz[new]
    return found


def _prepared(recordings: Path, folder: Path, **options) -> data.Records:
    """The recordings' records, prepared if they are missing."""
    spec = prepare_spec(varied.get_config())
    data.prepare(recordings, folder, spec, workers=1, **options)
    return data.Records(folder, "test")


if __name__ == "__main__":
    sys.exit(main())
