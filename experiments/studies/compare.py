r"""Do two runs differ? The scores of the same frames, with paired tests.

    python -m experiments.studies.compare runs/first runs/second
    python -m experiments.studies.compare runs/first runs/second --frames frames.csv
    python -m experiments.studies.compare runs/first --reference OS-CFAR

Every method that both runs have is subtracted frame by frame; tests allow for frames
that follow one another. With `--reference`, every method of all the runs is compared
with one of them.
"""

import argparse
import sys

import jax

from jradar import evaluation
from jradar.evaluation.runs import COMPARED
from jradar.files import write_text


def main(argv: list[str] | None = None) -> int:
    """Print the comparison; 2 where the runs do not go together."""
    parser = argparse.ArgumentParser(prog="experiments.studies.compare")
    parser.add_argument("runs", nargs="+", metavar="RUN", help="workdir of a run")
    parser.add_argument("--reference", metavar="METHOD", help="compare all with this")
    parser.add_argument("--frames", metavar="FILE", help="write every frame as CSV")
    options = parser.parse_args(argv)
    try:
        print(_tables(options))
    except (ValueError, FileNotFoundError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _tables(options: argparse.Namespace) -> str:
    """What the options ask for, in Markdown."""
    key = jax.random.key(0)
    if options.reference:
        scores = evaluation.read_runs(options.runs)
        return "\n".join(
            evaluation.comparison_table(
                key, scores, reference=options.reference, score=score
            )
            for score in COMPARED
        )
    if len(options.runs) != 2:
        raise ValueError(f"{len(options.runs)} runs, expected two runs or --reference")
    path = "{}/evaluation/frames.jsonl"
    first, second = (evaluation.read_scores(path.format(r)) for r in options.runs)
    if options.frames:
        write_text(options.frames, evaluation.frames_csv(first, second))
    return evaluation.runs_table(key, first, second)


if __name__ == "__main__":
    sys.exit(main())
