r"""The confidence of a model, made to hold on frames that it was not trained on.

    python -m experiments.confidence jradar-sim RECORDS [RECORDS ...] -o FOLDER

Training does this with its own validation frames. The command does it again with the
records of other radars, which have a LiDAR, and writes the model to a new folder. The
network stays the same.
"""

import sys
from argparse import Namespace
from pathlib import Path

import jax
import numpy as np

from experiments.command import run_study, study_parser
from jradar import data
from jradar.errors import UsageError
from jradar.evaluation import with_confidence
from jradar.evaluation.confidence import FRAMES
from jradar.model import load_model, save_model

KEY = 0
DTYPES = {"float32": np.float32, "float16": np.float16, "int8": np.int8}


def main(argv: list[str] | None = None) -> int:
    """Fit a model's confidence to records and return the exit code."""
    parser = study_parser("experiments.confidence", __doc__, output="new folder")
    parser.add_argument("model", help="a shipped model, or a folder")
    parser.add_argument("records", nargs="+", type=Path, help="folders of records")
    text = "split of the records, or all (default: %(default)s)"
    parser.add_argument("--split", default="validation", help=text)
    text = "precision of the weights that are written"
    parser.add_argument("--dtype", choices=DTYPES, default="float16", help=text)
    return run_study(fit, parser, argv)


def fit(options: Namespace) -> None:
    """Write the model with a confidence that holds on the records."""
    model = load_model(options.model)
    split = None if options.split == "all" else options.split
    sets = [data.Records(folder, split) for folder in options.records]
    fitted = with_confidence(jax.random.key(KEY), model, *sets)
    if fitted is model:
        raise UsageError(
            f"{options.model} gives no confidence, or none of its points has a truth "
            f"in {', '.join(map(str, options.records))}"
        )
    save_model(options.output, fitted, dtype=DTYPES[options.dtype])
    frames = sum(min(len(records), FRAMES) for records in sets)
    print(
        f"{options.output}: confidence fitted to {frames} frames, points of less than "
        f"{fitted.tables.confidence.least:g} are left out"
    )


if __name__ == "__main__":
    sys.exit(main())
