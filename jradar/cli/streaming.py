"""`jradar live` and `jradar replay`: a radar on the cable, or a recording instead."""

import argparse
import contextlib
import functools
import sys
from typing import Any

import numpy as np

from jradar.cli.one_line import say
from jradar.cli.reading import given, opening
from jradar.errors import UsageError
from jradar.model import Model, load_model
from jradar.recordings import Recording, nearest_scan, open_recording
from jradar.stream import (
    Card,
    Emulator,
    FaultSpec,
    NetworkSpec,
    Processor,
    Receiver,
    RecordedFrames,
    frame_bytes,
    loopback_network,
    open_writer,
    quickest,
    radar_on_the_cable,
    run_live,
    summary,
)
from jradar.stream.live import ended_by_signals
from jradar.stream.outputs import Writer
from jradar.stream.views import FALLBACK_PERIOD_S

NO_MODEL = "none"
FOUR_LANES = ("I4Q4", "Q4I4")
DRAIN_S = 1.0  # after the last packet of a replay


def live_session(options: argparse.Namespace) -> dict[str, Any]:
    """Publish the clouds of a radar until Ctrl-C, or of a recording until its end."""
    recording = _recording(options)
    model = _model(options, recording)
    drawing = quickest(model, draws=options.draws, steps=options.steps)
    processor = Processor(recording, model=model, seed=options.seed, **drawing)
    network = loopback_network() if options.replay else _network(options)
    with contextlib.ExitStack() as stack:
        receiver = Receiver(frame_bytes(recording), network)
        stack.callback(receiver.close)
        writers = _writers(options, stack)
        print("compiling ..", file=sys.stderr, flush=True)
        processor.warm_up()
        stack.enter_context(receiver)
        emulator = _emulator(options, recording, network, stack)
        stack.enter_context(_started(options, recording, network))
        session = run_live(
            receiver,
            processor,
            writers,
            silence_s=options.silence,
            seconds=options.seconds,
            finished=lambda: _played(emulator, receiver),
            lidar=functools.partial(_scan, recording),
            say=say,
        )
        receiver.close()
        if emulator is not None and emulator.fault is not None:
            raise emulator.fault
    written = [options.output] if options.output else []
    return {
        "radar": recording.radar.spec.name,
        "recording": options.replay or "",
        "model": options.model,
        **summary(session, receiver),
        "notes": [*recording.notes, *session.warnings],
        "written": written,
    }


def replay_recording(options: argparse.Namespace) -> dict[str, Any]:
    """Send a recording as the capture card would, once a program asks for it."""
    recording = open_recording(options.path, **opening(options))
    network = _network(options)
    with _new_emulator(options, recording, network) as emulator:
        if options.now:
            emulator.start()
        else:
            print(
                f"the card at {network.card} waits for START on port "
                f"{network.command_port}",
                file=sys.stderr,
                flush=True,
            )
        with ended_by_signals() as ending:
            while not (emulator.finished.is_set() or ending.is_set()):
                ending.wait(0.1)
        emulator.stop()
        if emulator.fault is not None:
            raise emulator.fault
        sent = emulator.sent
    return {
        "recording": str(recording.path),
        "radar": recording.radar.spec.name,
        "frames sent": sent.frames,
        "packets sent": sent.packets,
        "packets lost on purpose": sent.lost,
        "packets sent twice": sent.repeated,
        "notes": [*recording.notes],
    }


def _recording(options: argparse.Namespace) -> Recording:
    """The recording to replay, or the radar that `--radar` describes."""
    if options.replay:
        return open_recording(options.replay, **opening(options))
    if not options.radar:
        raise UsageError(
            "name the radar's description with --radar, such as the .cfg that runs on "
            "the board, or a recording with --replay"
        )
    return radar_on_the_cable(options.radar, **given(options, "device", "iq_order"))


def _model(options: argparse.Namespace, recording: Recording) -> Model | None:
    """The model, or None; UsageError for a radar that measures no elevation."""
    if options.model == NO_MODEL:
        return None
    if not (recording.radar.spec.has_elevation or options.anyway):
        raise UsageError(
            f"{recording.radar.spec.name} has one row of antennas and measures no "
            "elevation: publish its detections with --model none, or add --anyway"
        )
    return load_model(options.model)


def _network(options: argparse.Namespace) -> NetworkSpec:
    return NetworkSpec(
        host=options.host,
        card=options.card,
        command_port=options.command_port,
        data_port=options.data_port,
    )


def _writers(options: argparse.Namespace, stack: contextlib.ExitStack) -> list[Writer]:
    """Open the outputs; they are closed with the stack."""
    writers = []
    if options.output:
        writers.append(open_writer(options.output))
        stack.callback(writers[-1].close)
    if options.serve is not None:
        from jradar.stream.server import Server

        server = Server(
            host=options.serve_host,
            port=options.serve,
            allow_origins=options.allow_origin,
            say=say,
        )
        stack.callback(server.close)
        writers.append(server)
        print(
            f"open Foxglove and connect to ws://{server.host}:{server.port}",
            file=sys.stderr,
            flush=True,
        )
    return writers


def _emulator(options, recording, network, stack) -> Emulator | None:
    """A card that plays the recording of `--replay`."""
    if not options.replay:
        return None
    return stack.enter_context(_new_emulator(options, recording, network))


def _new_emulator(options, recording: Recording, network: NetworkSpec) -> Emulator:
    return Emulator(
        RecordedFrames(recording),
        network,
        period_s=_period_s(recording) / options.speed,
        faults=FaultSpec(options.loss, options.reorder, options.duplicate),
        repeat=options.repeat,
    )


def _period_s(recording: Recording) -> float:
    """The time from frame to frame: as described, or as recorded."""
    stamps = recording.cubes.stamps
    if recording.radar.spec.frame_period_s:
        return recording.radar.spec.frame_period_s
    if stamps is not None and len(stamps) > 1:
        return float(np.median(np.diff(stamps)))
    return FALLBACK_PERIOD_S


def _scan(recording: Recording, number: int) -> np.ndarray | None:
    """The LiDAR scan that was recorded beside a frame that is replayed."""
    if recording.lidar is None:
        return None
    return nearest_scan(recording, number % len(recording.cubes))


def _played(emulator: Emulator | None, receiver: Receiver) -> bool:
    """True once a replay is over and its packets have had time to arrive."""
    return (
        emulator is not None
        and emulator.finished.is_set()
        and bool(receiver.silence(DRAIN_S))
    )


@contextlib.contextmanager
def _started(options, recording: Recording, network: NetworkSpec):
    """Start the card, then the board; stop both at the end."""
    with contextlib.ExitStack() as stack:
        if not options.no_commands or options.replay:
            lanes = 4 if recording.iq_order in FOUR_LANES else 2
            card = stack.enter_context(Card(network))
            card.set_up(lanes=lanes, delay_us=options.packet_delay)
            card.start()
            stack.callback(_quietly, card.stop)
        if options.board:
            from jradar.stream.board import Board

            if not str(options.radar).endswith(".cfg"):
                raise UsageError(
                    f"--board sends a .cfg to the board, --radar is {options.radar}"
                )
            board = stack.enter_context(Board(options.board))
            stack.callback(_quietly, board.stop)
            board.configure(options.radar)
        yield


def _quietly(stop) -> None:
    """Stop a device; one that does not answer any more changes nothing."""
    with contextlib.suppress(OSError, ValueError):
        stop()
