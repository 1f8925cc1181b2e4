"""`jradar live`, `record` and `replay`: a radar on the cable, or an emulated one."""

import argparse
import contextlib
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jradar
from jradar.cli.groups import given_drawing
from jradar.cli.printing import say
from jradar.cli.reading import given, opening
from jradar.cli.verbosity import LOG
from jradar.errors import UsageError

if TYPE_CHECKING:
    from jradar.outputs.writers import Writer
    from jradar.recordings import Recording
    from jradar.stream import Emulator, NetworkSpec, Source
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
    with contextlib.ExitStack() as stack:
        source, run_session = _listen(options, recording, stack)
        processor = stream.Processor(
            recording,
            model=model,
            fuse=options.fuse,
            history_s=options.history,
            seed=options.seed,
            anyway=options.anyway,
            **stream.quickest(model, **given_drawing(options)),
        )
        writers = open_writers(options, stack)
        LOG.warning("compiling ..")
        session = run_session(processor, writers)
    return {
        "radar": "" if recording.radar is None else recording.radar.spec.name,
        "port": options.points or "",
        "recording": options.replay or "",
        "model": options.model,
        **stream.summary(session, source),
        "notes": [*recording.notes, *processor.warnings, *session.warnings],
        "written": [options.output] if options.output else [],
    }


def _listen(
    options: argparse.Namespace,
    recording: "Recording",
    stack: contextlib.ExitStack,
    *,
    waiting: int = 1,
) -> "tuple[Source, Callable[..., Session]]":
    """Return the source of a radar's frames, and the function that runs a session.

    The stack closes the source, and the emulated card that --replay needs for samples.
    """
    stream, devices, more = jradar.stream, [], {}
    if not recording.of_points:
        network = stream.loopback_network() if options.replay else _network(options)
        size = stream.frame_bytes(recording)
        source = stream.Receiver(size, network, waiting=waiting)
        if options.replay:
            emulator = _emulator(options, recording, network)
            stack.callback(emulator.close)
            devices.append(stream.emulator_runs(emulator))
            more["finished"] = functools.partial(stream.played, emulator, source)
        if options.replay or not options.no_commands:
            delay_us = options.packet_delay
            card = stream.card_runs(network, recording, packet_delay_us=delay_us)
            devices.append(card)
    elif options.replay:
        playing = {"speed": options.speed, "repeat": options.repeat}
        source = player = stream.Player(recording.frames, **playing)
        more["finished"] = lambda: player.finished
    else:
        source = stream.PointsPort(options.points, recording)
    stack.callback(source.close)
    if options.board:
        devices.append(stream.board_runs(options.board, options.radar))
    return source, functools.partial(
        stream.run_session,
        source,
        devices=devices,
        silence_s=options.silence,
        seconds=options.seconds,
        say=say,
        **more,
    )


def record(options: argparse.Namespace) -> dict[str, Any]:
    """Record the raw frames of a radar on the cable, with their times and losses."""
    recording = _recording(options)
    if recording.of_points:
        raise UsageError(
            f"{recording.path} holds a radar's points, and `jradar record` writes "
            "samples: `jradar live --model none -o walk.ros2` saves points"
        )
    with contextlib.ExitStack() as stack:
        source, run_session = _listen(options, recording, stack, waiting=WAITING)
        recorder = jradar.recordings.open_recorder(options.output, recording)
        stack.enter_context(recorder)
        session = run_session(
            jradar.stream.Processor(recording),
            (),
            keep=lambda f: recorder.write(f.data, f.stamp_s, f.lost_bytes),
        )
    lost = source.describe()
    return {
        "radar": recording.radar.spec.name,
        "frames recorded": recorder.frames,
        "frames missing": lost["frames missing"] + source.received - recorder.frames,
        "frames with losses": lost["frames with losses"],
        "lost bytes": recorder.lost_bytes,
        "notes": [*recording.notes, *session.warnings],
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
            LOG.warning(
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
    """Return the recording to replay, or the radar on the cable, without frames."""
    stream, points = jradar.stream, options.points
    if options.replay:
        if unused := [
            o for o in ("board", "points") if getattr(options, o) is not None
        ]:
            raise UsageError(f"--replay needs no board: leave out --{unused[0]}")
        recording = jradar.open_recording(options.replay, **opening(options))
    elif not options.radar and (points is None or options.board):
        raise UsageError(
            "name the radar's description with --radar, such as the .cfg that runs on "
            "the board, or a recording with --replay"
        )
    elif points is None:
        described = given(options, "device", "iq_order")
        recording = stream.radar_on_the_cable(options.radar, **described)
    else:
        options.points = points or _data_port(options.board)
        described = given(options, "device")
        recording = stream.points_on_the_cable(
            options.points, options.radar, **described
        )
    if recording.of_points:
        _refuse(options)
    return recording


def _data_port(board: str | None) -> str:
    """Return the data port of a board whose command port is named."""
    if board is None:
        raise UsageError(
            "--points: name the board's data port, such as --points /dev/ttyACM1, or "
            "its command port with --board"
        )
    return jradar.stream.second_port(board)


def _refuse(options: argparse.Namespace) -> None:
    """Raise UsageError for options of samples and of their card."""
    changed = (
        o
        for o, usual in options.of_samples.items()
        if getattr(options, o, usual) != usual
    )
    if name := next(changed, None):
        raise UsageError(
            f"--{name.replace('_', '-')} is for samples, and this radar sends points: "
            "leave it out"
        )


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
    """Open the outputs; the stack closes them, files before the server."""
    writers: list[Writer] = []
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
        LOG.warning(
            "open https://app.foxglove.dev, or the application, and connect to "
            f"ws://{server.host}:{server.port} (Foxglove WebSocket)"
        )
    if options.output:
        from jradar.outputs.writers import open_writer

        writers.append(open_writer(options.output, force=options.force))
        stack.callback(writers[-1].close)
    return writers
