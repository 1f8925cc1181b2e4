"""A whole live session: the devices that feed a source, and the loop that publishes."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from jradar.errors import UsageError
from jradar.outputs.writers import Writer
from jradar.recordings import Recording
from jradar.stream.board import Board
from jradar.stream.card import Card
from jradar.stream.emulator import Emulator, Sent
from jradar.stream.live import SILENCE_S, Session, ended_by_signals, run_live
from jradar.stream.processing import Processor
from jradar.stream.protocol import NetworkSpec
from jradar.stream.source import WAKE_S, ReceivedFrame, Source

FOUR_LANES = ("I4Q4", "Q4I4")
DRAIN_S = 1.0  # after the last packet of a replay
Devices = AbstractContextManager[object]


def run_session(
    source: Source,
    processor: Processor,
    writers: Sequence[Writer],
    *,
    devices: Sequence[Devices] = (),
    finished: Callable[[], bool] = lambda: False,
    silence_s: float = SILENCE_S,
    seconds: float | None = None,
    keep: Callable[[ReceivedFrame], None] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Session:
    """Start a radar's devices, publish frames as `run_live` does, and stop them.

    `devices` start in their order, once the source listens: `card_runs`, `board_runs`
    or `emulator_runs`.
    """
    if keep is None:
        processor.warm_up()
    with contextlib.ExitStack() as stack:
        stack.enter_context(source)
        for device in devices:
            stack.enter_context(device)
        session = run_live(
            source,
            processor,
            writers,
            silence_s=silence_s,
            seconds=seconds,
            finished=finished,
            keep=keep,
            say=say,
        )
        source.close()  # what comes while the devices stop does not count
    return session


@contextlib.contextmanager
def card_runs(
    network: NetworkSpec, recording: Recording, *, packet_delay_us: float = 25.0
) -> Iterator[None]:
    """Configure and start the capture card, and stop it at the end."""
    lanes = 4 if recording.iq_order in FOUR_LANES else 2
    with Card(network) as card:
        card.set_up(lanes=lanes, delay_us=packet_delay_us)
        card.start()
        with _stopping(card.stop):
            yield


def board_runs(port: str, cfg: Path | str) -> Devices:
    """Send a board its .cfg, over its command port, and stop the radar at the end.

    Raises UsageError for another description.
    """
    if Path(cfg).suffix != ".cfg":
        raise UsageError(f"--board sends a .cfg to the board, but --radar is {cfg}")

    @contextlib.contextmanager
    def running() -> Iterator[None]:
        with Board(port) as board, _stopping(board.stop):
            board.configure(cfg)
            yield

    return running()


@contextlib.contextmanager
def emulator_runs(emulator: Emulator) -> Iterator[None]:
    """Answer commands; at the end, raise the error that ended the recording, if any."""
    with emulator:
        yield
    if emulator.fault is not None:
        raise emulator.fault


def played(emulator: Emulator, receiver: Source) -> bool:
    """Return whether a recording is over and its packets have had time to arrive."""
    return emulator.finished.is_set() and bool(receiver.silence(DRAIN_S))


@contextlib.contextmanager
def _stopping(stop: Callable[[], None]) -> Iterator[None]:
    """Stop a device at the end; ignore one that no longer answers."""
    try:
        yield
    finally:
        with contextlib.suppress(OSError, ValueError):
            stop()


def run_replay(emulator: Emulator) -> Sent:
    """Wait until a recording is sent, or a signal ends it; return what was sent.

    Raises the error that ended the sending, such as that of a damaged frame.
    """
    with ended_by_signals() as ending:
        while not (emulator.finished.is_set() or ending.is_set()):
            ending.wait(WAKE_S)
    emulator.stop()
    if emulator.fault is not None:
        raise emulator.fault
    return emulator.sent
