"""How late are the clouds of a radar that sends points, and does a session lose any?

    python -m benchmarks.soak_points --seconds 60 --model NAME --rate 20 --points 500

Another process writes TI's stream to a pseudo-terminal, which the session reads as the
data port of a board. Frames, bytes, memory and latency are printed at the end.
"""

import argparse
import json
import multiprocessing
import os
import time
import tty
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.soak_stream import memory_mib
from jradar import stream
from jradar.model import load_model
from tests.recordings.points.ti_writer import packet

SHAPES = 8  # frames that are sent again and again
LOW, HIGH = (-5, 1, -1, -1), (5, 11, 2, 1)  # x right, y forward, z up, velocity


def send(points: int, period_s: float, ends: Any) -> None:
    """Send the name of a port; from the next message to the one after it, packets."""
    line, port = os.openpty()
    tty.setraw(port)
    drawn = np.random.default_rng(0).uniform(LOW, HIGH, (SHAPES, points, 4)).tolist()
    ends.send(os.ttyname(port))
    ends.recv()
    begin, number = time.monotonic(), 0
    while not ends.poll(max(begin + number * period_s - time.monotonic(), 0.0)):
        left = packet(number, drawn[number % SHAPES], [20.0] * points)
        while left:
            left = left[os.write(line, left) :]
        number += 1
    ends.send(number)


def soak(options: argparse.Namespace) -> dict[str, Any]:
    """Run one session and return its numbers."""
    model = None if options.model == "none" else load_model(options.model)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    board = context.Process(target=send, args=(options.points, 1 / options.rate, there))
    board.start()
    try:
        recording = stream.points_on_the_cable(here.recv())
        drawing = stream.quickest(model, draws=None, steps=None)
        processor = stream.Processor(recording, model=model, **drawing)
        processor.warm_up()
        with stream.PointsPort(str(recording.path), recording) as port:
            here.send("begin")
            session = stream.run_live(
                port, processor, [], seconds=options.seconds, say=print
            )
            here.send("end")
            sent = here.recv()
    finally:
        board.terminate()
        board.join()
    return {
        "frames sent": sent,
        **stream.summary(session, port),
        "memory at the end (MiB)": round(memory_mib(), 1),
        "notes": session.warnings,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse the options, run a session, print its numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--model", default="none", help="name, folder, or none")
    parser.add_argument("--rate", type=float, default=20.0, help="frames a second")
    parser.add_argument("--points", type=int, default=500, help="points in a frame")
    print(json.dumps(soak(parser.parse_args(arguments)), indent=2))


if __name__ == "__main__":
    main()
