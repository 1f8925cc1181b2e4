"""`jradar live`, `record` and `replay`: a radar on the cable, or an emulated one."""

import argparse
import contextlib
import functools
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jradar
from jradar.cli.groups import given_drawing
from jradar.cli.printing import say
from jradar.cli.reading import given, opening
from jradar.errors import UsageError

if TYPE_CHECKING:
    from jradar.outputs.writers import Writer
    from jradar.recordings import Recording
    from jradar.stream import Emulator, NetworkSpec, Receiver
    from jradar.stream.live import Session

NO_MODEL = "none"
WAITING = 64  # frames that wait for the disk


def live(options: argparse.Namespace) -> dict[str, Any]:
    """Publish dense clouds of a radar on the cable, as it runs."""
    stream, recording = jradar.stream, _recording(options)
    model = None
    if options.model != NO_MODEL:
        loaded = jradar.load_model(options.model)
        remove = options.remove_interference or None
        model = jradar.pipeline.without_interference(loaded, remove)
    processor = stream.Processor(
        recording,
        model=model,
        fuse=options.fuse,
        seed=options.seed,
        anyway=options.anyway,
        **stream.quickest(model, **given_drawing(options)),
    )
    with contextlib.ExitStack() as stack:
        receiver, run_session = _listen(options, recording, stack)
        writers = open_writers(options, stack)
        _tell("compiling ..")
        session = run_session(processor, writers)
    return {
        "radar": recording.radar.spec.name,
        "recording": options.replay or "",
        "model": options.model,
        **stream.summary(session, receiver),
        "notes": [*recording.notes, *processor.warnings, *session.warnings],
        "written": [options.output] if options.output else [],
    }


def _listen(
    options: argparse.Namespace,
    recording: "Recording",
    stack: contextlib.ExitStack,
    *,
    waiting: int = 1,
) -> "tuple[Receiver, Callable[..., Session]]":
    """Return the receiver of a radar's frames, and the function that runs a session.

    An emulated card plays the recording of --replay. The stack closes both.
    """
    stream, emulator = jradar.stream, None
    network = stream.loopback_network() if options.replay else _network(options)
    size = stream.frame_bytes(recording)
    receiver = stream.Receiver(size, network, waiting=waiting)
    stack.callback(receiver.close)
    if options.replay:
        emulator = _emulator(options, recording, network)
        stack.callback(emulator.close)
    return receiver, functools.partial(
        stream.run_session,
        receiver,
        emulator=emulator,
        commands=not options.no_commands,
        packet_delay_us=options.packet_delay,
        board=options.board,
        silence_s=options.silence,
        seconds=options.seconds,
        say=say,
    )


def record(options: argparse.Namespace) -> dict[str, Any]:
    """Record the raw frames of a radar on the cable, with their times and losses."""
    source = _recording(options)
    with contextlib.ExitStack() as stack:
        receiver, run_session = _listen(options, source, stack, waiting=WAITING)
        recorder = jradar.recordings.open_recorder(options.output, source)
        stack.enter_context(recorder)
        session = run_session(
            jradar.stream.Processor(source),
            (),
            keep=lambda f: recorder.write(f.data, f.stamp_s, f.lost_bytes),
        )
    counts = receiver.counts
    return {
        "radar": source.radar.spec.name,
        "frames recorded": recorder.frames,
        "frames missing": counts.missing + counts.frames - recorder.frames,
        "frames with losses": counts.damaged,
        "lost bytes": recorder.lost_bytes,
        "notes": [*source.notes, *session.warnings],
        "written": [options.output],
    }


def replay(options: argparse.Namespace) -> dict[str, Any]:
    """Send a recording over UDP as the DCA1000 capture card would."""
    recording = jradar.open_recording(options.path, **opening(options))
    network = _network(options)
    with _emulator(options, recording, network) as emulator:
        if options.now:
            emulator.start()
        else:
            _tell(
                f"the card at {network.card} waits for START on port "
                f"{network.command_port}"
            )
        sent = jradar.stream.run_replay(emulator)
    return {
        "recording": str(recording.path),
        "radar": recording.radar.spec.name,
        "frames sent": sent.frames,
        "packets sent": sent.packets,
        "packets lost on purpose": sent.lost,
        "packets sent twice": sent.repeated,
        "notes": [*recording.notes],
    }


def _recording(options: argparse.Namespace) -> "Recording":
    """Return the recording to replay, or the radar that `--radar` describes."""
    if options.replay:
        recording = jradar.open_recording(options.replay, **opening(options))
        jradar.recordings.need_samples(recording)
        return recording
    if not options.radar:
        raise UsageError(
            "name the radar's description with --radar, such as the .cfg that runs on "
            "the board, or a recording with --replay"
        )
    described = given(options, "device", "iq_order")
    return jradar.stream.radar_on_the_cable(options.radar, **described)


def _network(options: argparse.Namespace) -> "NetworkSpec":
    return jradar.stream.NetworkSpec(
        host=options.host,
        card=options.card,
        command_port=options.command_port,
        data_port=options.data_port,
    )


def _emulator(
    options: argparse.Namespace, recording: "Recording", network: "NetworkSpec"
) -> "Emulator":
    """Return a card that plays the recording."""
    stream = jradar.stream
    faults = stream.FaultSpec(options.loss, options.reorder, options.duplicate)
    return stream.replaying(
        recording, network, speed=options.speed, faults=faults, repeat=options.repeat
    )


def open_writers(
    options: argparse.Namespace, stack: contextlib.ExitStack
) -> "list[Writer]":
    """Open the outputs; the stack closes them."""
    writers: list[Writer] = []
    if options.output:
        from jradar.outputs.writers import open_writer

        writers.append(open_writer(options.output, force=options.force))
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
        _tell(f"open Foxglove and connect to ws://{server.host}:{server.port}")
    return writers


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
