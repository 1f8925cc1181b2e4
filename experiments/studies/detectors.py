r"""Score CFAR detectors on records, as the rows that every method is compared with.

    python -m experiments.studies.detectors RECORDS -o runs/detectors

Each detector has its best false-alarm rate on the validation split; the scores are of
the test split. Only points in the records' field of view count.

Records contain one direction for each cell. For rows with MUSIC's directions, prepare
the same recordings with `jradar prepare --spec FILE`, where FILE sets angles = "music".
"""

import sys
from argparse import Namespace

import jax

from experiments.command import run_study, study_parser
from experiments.detectors import choose_rates, detector_methods
from experiments.evaluate import view_of, write_results
from jradar import data


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("detectors", __doc__)
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("--every", type=int, default=1, help="score every n-th frame")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Choose rates, score the detectors, and write tables and a report."""
    records = data.Records(options.records, "test")
    view = view_of(records)
    rates = choose_rates(view, data.Records(options.records, "validation"))
    print(f"false-alarm rates: {rates}")
    angles = records.manifest["options"].get("angles", "fft")
    write_results(
        jax.random.key(0),
        options.output,
        view,
        records,
        data.PairSource(records, view.fine, view.fine, num_slices=1),
        detector_methods(view, rates, angles=angles),
        every=options.every,
    )


if __name__ == "__main__":
    sys.exit(main())
