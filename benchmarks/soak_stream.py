"""How long does a live session hold, and how late are its clouds?

    python -m benchmarks.soak_stream --seconds 600 --model NAME --loss 0.01 --reorder 8

An emulated card in another process plays frames of the single chip's waveform, ten a
second (`--rate`) of 540 packets, over the loopback. Frames, packets, memory and latency
are printed at the end; every undamaged frame is compared with the one that was sent.
"""

import argparse
import contextlib
import hashlib
import json
import multiprocessing
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jradar import stream
from jradar.model import load_model
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream

SHAPES = 8  # frames that are played again and again
MINUTE_S = 60.0
PAGE_MIB = 4096 / (1 << 20)


def noise_frames(radar: RadarSpec) -> list[bytes]:
    """Return frames of noise, as the card sends them."""
    noise = np.random.default_rng(0).normal(
        scale=20, size=(SHAPES, *radar.cube_shape, 2)
    )
    return [frame.astype("<i2").tobytes() for frame in noise]


def play(frames: list[bytes], network: stream.NetworkSpec, ends, period_s, faults):
    """Run the card until `ends`, a pipe, gets a message; send back what was sent."""
    options = {"period_s": period_s, "faults": faults, "repeat": True}
    with stream.Emulator(frames, network, **options) as emulator:
        ends.send("ready")
        ends.recv()
        emulator.stop()
        ends.send(vars(emulator.sent))


class Checked(stream.Processor):
    """A processor that compares each frame with those that were sent."""

    def __init__(self, frames: list[bytes], **options: Any):
        """`options` are those of `Processor`."""
        super().__init__(**options)
        self.digests = {hashlib.sha256(frame).digest() for frame in frames}
        self.begin(0.0)

    def begin(self, now_s: float) -> None:
        """Start counting."""
        self.begin_s, self.same, self.after_a_minute = now_s, 0, memory_mib()

    def cube(self, data: np.ndarray) -> np.ndarray:
        """Count frames that are bit-identical to one that was sent."""
        self.same += hashlib.sha256(data).digest() in self.digests
        if time.monotonic() - self.begin_s < MINUTE_S:
            self.after_a_minute = memory_mib()
        return super().cube(data)


def memory_mib() -> float:
    """Return the memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MIB


def soak(options: argparse.Namespace) -> dict[str, Any]:
    """Run one session and return its numbers."""
    radar = RadarSpec.awr1843()
    frames, network = noise_frames(radar), stream.loopback_network()
    recording = Recording(
        "soak", Path("soak"), Radar(radar), Stream(frames.__getitem__, SHAPES)
    )
    model = None if options.model == "none" else load_model(options.model)
    drawing = stream.quickest(model, draws=None, steps=None)
    processor = Checked(frames, recording=recording, model=model, **drawing)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    faults = stream.FaultSpec(options.loss, options.reorder)
    played = frames, network, there, 1 / options.rate, faults
    card = context.Process(target=play, args=played)
    with contextlib.ExitStack() as stack:
        processor.warm_up()
        receiver = stack.enter_context(
            stream.Receiver(stream.frame_bytes(recording), network)
        )
        card.start()
        try:
            here.recv()
            with stream.Card(network, timeout_s=10.0) as commands:
                commands.set_up()
                commands.start()
                processor.begin(time.monotonic())
                session = stream.run_live(
                    receiver, processor, [], seconds=options.seconds, say=print
                )
                commands.stop()
            here.send("end")
            sent = here.recv()
        finally:
            card.terminate()
            card.join()
        receiver.close()
    return {
        "sent": sent,
        **stream.summary(session, receiver),
        "published and bit-identical": processor.same,
        "memory at a minute (MiB)": round(processor.after_a_minute, 1),
        "memory at the end (MiB)": round(memory_mib(), 1),
        "notes": session.warnings,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse the options, run a session, print its numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--model", default="none", help="name, folder, or none")
    parser.add_argument("--rate", type=float, default=10.0, help="frames a second")
    parser.add_argument("--loss", type=float, default=0.0, help="share of packets")
    parser.add_argument("--reorder", type=int, default=0, help="packets")
    print(json.dumps(soak(parser.parse_args(arguments)), indent=2))


if __name__ == "__main__":
    main()
