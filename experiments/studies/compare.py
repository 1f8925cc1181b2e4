r"""Compare the scores of runs frame by frame, with paired tests.

    python -m experiments.studies.compare runs/first runs/second
    python -m experiments.studies.compare runs/first --reference OS-CFAR

Two runs: every method that both contain, second minus first. With `--reference`: every
method of all the runs minus that one. The tests allow for correlated frames.
"""

import sys
from argparse import Namespace

import jax

from experiments.command import run_study, study_parser
from jradar import evaluation
from jradar.errors import UsageError
from jradar.evaluation.runs import COMPARED


def main(argv: list[str] | None = None) -> int:
    """Print the comparison and return the exit code."""
    parser = study_parser("experiments.studies.compare", __doc__, output="")
    parser.add_argument("runs", nargs="+", metavar="RUN", help="workdir of a run")
    parser.add_argument("--reference", metavar="METHOD", help="compare all with this")
    return run_study(lambda options: print(tables(options)), parser, argv)


def tables(options: Namespace) -> str:
    """Return the comparison in Markdown."""
    key = jax.random.key(0)
    if options.reference:
        scores = evaluation.read_runs(options.runs)
        methods = [*dict.fromkeys(row["method"] for row in scores)]
        if options.reference not in methods:
            raise UsageError(f"--reference {options.reference!r} is none of {methods}")
        return "\n".join(
            evaluation.comparison_table(
                key, scores, reference=options.reference, score=score
            )
            for score in COMPARED
        )
    if len(options.runs) != 2:
        raise UsageError(f"{len(options.runs)} runs, expected two runs or --reference")
    path = "{}/evaluation/frames.jsonl"
    first, second = (evaluation.read_scores(path.format(r)) for r in options.runs)
    return evaluation.runs_table(key, first, second)


if __name__ == "__main__":
    sys.exit(main())
