"""Run all benchmarks and print one table.

    python -m benchmarks.run [--quick] [--only ROOM] [--json FILE]

The ratio is our median time divided by the fastest peer's in the same run: below 1
jradar is faster. Close other programs first.
"""

import argparse
import importlib
import json
import os
import platform
import sys
import time
from pathlib import Path

import jax

from benchmarks.harness import measure

ROOMS = sorted(path.stem[6:] for path in Path(__file__).parent.glob("bench_*.py"))


def main(argv: list[str] | None = None) -> int:
    """Run the benchmarks that the options select."""
    parser = argparse.ArgumentParser(
        prog="benchmarks.run", description="Run all benchmarks."
    )
    parser.add_argument(
        "--quick", action="store_true", help="run a few rounds of each case"
    )
    parser.add_argument("--only", choices=ROOMS, help="run the benchmarks of one room")
    parser.add_argument("--json", metavar="FILE", help="write all times to this file")
    options = parser.parse_args(argv)
    machine = {
        "date": time.strftime("%Y-%m-%d"),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "jax": f"{jax.__version__} on {jax.default_backend()}",
        "python": platform.python_version(),
    }
    print(", ".join(machine.values()), file=sys.stderr)
    print("| kernel | compile (ms) | median (ms) | best peer | its ms | ratio |")
    print("|---|---|---|---|---|---|")
    results = []
    for room in [options.only] if options.only else ROOMS:
        module = importlib.import_module(f"benchmarks.bench_{room}")
        for case in module.cases():
            rounds = {"seconds": 0.2, "least": 1} if options.quick else {}
            timing = measure(case, **rounds)
            results.append({"room": room, **timing._asdict(), "ratio": timing.ratio})
            peer, its = timing.best_peer, " | "
            if peer is not None:
                its = f"{timing.peers_ms[peer]:.3f} | {timing.ratio:.3f}"
            print(
                f"| {timing.name} | {timing.compile_ms:.0f} | {timing.median_ms:.3f} "
                f"| {peer or 'none installed'} | {its} |",
                flush=True,
            )
    if options.json:
        Path(options.json).write_text(
            json.dumps({**machine, "cases": results}, indent=2)
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
