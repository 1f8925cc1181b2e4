"""How long does a live session hold, and how late are its clouds?

    python -m benchmarks.soak_stream --seconds 600 --model NAME --loss 0.01 --reorder 8

An emulated card in another process plays frames of the single chip's waveform, at ten a
second, over the loopback. Frames, packets, memory and latency are printed at the end;
every undamaged frame is compared with the one that was sent.
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
from jradar.radar import RadarSpec
from jradar.recordings import Recording, Stream
from jradar.stream.outputs import Writer
from jradar.stream.protocol import BYTES, SEQUENCES

SHAPES = 8  # frames that are played again and again
MINUTE_S = 60.0
MEGABYTE = 1 << 20


def invented_frames(radar: RadarSpec) -> list[bytes]:
    """Return frames of noise and one echo, as the card sends them."""
    rng = np.random.default_rng(0)
    tx, rx, chirps, samples = radar.cube_shape
    wave = np.exp(2j * np.pi * 0.2 * np.arange(samples))
    frames = []
    for _ in range(SHAPES):
        noise = rng.normal(scale=20, size=(chirps, tx, rx, samples, 2))
        cube = noise[..., 0] + 1j * noise[..., 1] + 300 * wave
        pairs = np.stack([cube.real, cube.imag], -1).reshape(chirps, tx, rx, -1, 2, 2)
        words = np.rint(pairs.swapaxes(-1, -2)).astype("<i2")
        frames.append(words.tobytes())
    return frames


def play(
    frames: list[bytes], network: stream.NetworkSpec, ends, faults, period_s, wrap
):
    """Run the card until `ends`, a pipe, gets a message; send back what was sent."""
    size = len(frames[0])
    counters: dict[str, int] = {}
    if wrap:  # after three seconds
        ahead = 30 * size
        counters["first_byte"] = BYTES // size * size - ahead
        counters["first_sequence"] = SEQUENCES - ahead // 1456 // 2
    emulator = stream.Emulator(
        frames, network, period_s=period_s, faults=faults, repeat=True, **counters
    )
    with emulator:
        ends.send("ready")
        ends.recv()
        emulator.stop()
        ends.send(vars(emulator.sent))


class Checked(stream.Processor):
    """A processor that compares the bytes of each frame with those that were sent."""

    def __init__(self, frames: list[bytes], **options: Any):
        """`options` are those of `Processor`."""
        super().__init__(**options)
        self.digests = {hashlib.sha256(frame).digest() for frame in frames}
        self.same = 0

    def cube(self, data: np.ndarray) -> np.ndarray:
        """Count frames that are bit-identical to one that was sent."""
        self.same += hashlib.sha256(data).digest() in self.digests
        return super().cube(data)


class Memory:
    """A writer that notes the memory of this process, every second."""

    def __init__(self):
        self.begin_s, self.seen = time.monotonic(), []

    def write(self, _view: Any) -> None:
        """Note the memory if it is time."""
        elapsed = time.monotonic() - self.begin_s
        if not self.seen or elapsed - self.seen[-1][0] >= 1:
            status = Path("/proc/self/statm").read_text().split()
            self.seen.append((elapsed, int(status[1]) * 4096 / MEGABYTE))

    def close(self) -> None:
        """Nothing is left to do."""

    def at(self, seconds: float) -> float:
        """Return the megabytes at a time, or at the end."""
        return next((mb for t, mb in self.seen if t >= seconds), self.seen[-1][1])


def soak(options: argparse.Namespace) -> dict[str, Any]:
    """Run one session and return its numbers."""
    radar = RadarSpec.awr1843()
    frames, network = invented_frames(radar), stream.loopback_network()
    recording = Recording(
        "soak", Path("soak"), radar, Stream(frames.__getitem__, SHAPES)
    )
    model = None if options.model == "none" else load_model(options.model)
    drawing = stream.quickest(model, draws=options.draws, steps=options.steps)
    processor = Checked(frames, recording=recording, model=model, **drawing)
    faults = stream.FaultSpec(options.loss, options.reorder, options.duplicate)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    played = frames, network, there, faults, options.period, options.wrap
    card = context.Process(target=play, args=played)
    memory = Memory()
    writers: list[Writer] = [memory]
    with contextlib.ExitStack() as stack:
        if options.output:
            writers.append(
                stack.enter_context(
                    contextlib.closing(stream.open_writer(options.output))
                )
            )
        processor.warm_up()
        processor.same = 0
        receiver = stack.enter_context(
            stream.Receiver(stream.frame_bytes(recording), network)
        )
        card.start()
        try:
            here.recv()
            with stream.Card(network, timeout_s=10.0) as commands:
                commands.set_up()
                commands.start()
                memory.begin_s = time.monotonic()
                session = stream.run_live(
                    receiver, processor, writers, seconds=options.seconds, say=print
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
        "memory at a minute (MiB)": round(memory.at(MINUTE_S), 1),
        "memory at the end (MiB)": round(memory.seen[-1][1], 1),
        "notes": session.warnings,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse the options, run a session, print its numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    text = "seconds from frame to frame; 0.05 are 10,800 packets/s"
    parser.add_argument("--period", type=float, default=0.1, help=text)
    parser.add_argument("--model", default="none", help="name, folder, or none")
    parser.add_argument("--draws", type=int)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--reorder", type=int, default=0)
    parser.add_argument("--duplicate", type=float, default=0.0)
    parser.add_argument("--wrap", action="store_true", help="let the counters wrap")
    parser.add_argument("-o", "--output", help="also write an .mcap, .ros2 or folder")
    print(json.dumps(soak(parser.parse_args(arguments)), indent=2))


if __name__ == "__main__":
    main()
