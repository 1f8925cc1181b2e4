"""Simulate and prepare training frames of many places, see `jradar.simulation.drawn`.

    python -m experiments.places --set=jradar-sim-5 --maps=ColoRadar -o runs/sim5

`--maps` is a folder of packed runs of ColoRadar's maps; without it there are no frames
of real places. The same command resumes what was interrupted. Configs take the records
as --config.data.path=runs/sim5, and leave kinds out by --config.data.without=KIND,KIND.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from experiments import build
from experiments.configs import marginal
from jradar.simulation import DRAWN


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the records of a set, with the points that the shipped model takes."""
    words = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    words.add_argument("--set", default="jradar-sim-5", choices=[*DRAWN])
    words.add_argument("--maps", default="", help="folder of packed runs")
    words.add_argument("-o", "--output", required=True, type=Path)
    words.add_argument("--workers", default=1, type=int, help="processes")
    chosen = words.parse_args(arguments)
    config = marginal.get_config()
    config.data.set, config.data.maps = chosen.set, chosen.maps
    build.draw_places(config, chosen.output, workers=chosen.workers)


if __name__ == "__main__":
    main()
