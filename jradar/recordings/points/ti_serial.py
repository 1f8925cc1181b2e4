"""A saved stream of TI's demos: its bytes, or a CSV with a packet's bytes in each row.

    out.dat, out.bin       what the data port sent
    out.csv                Timestamp,RawData
                           2024-12-16 13:13:49.488641779,"2,1,4,3,6,5,8,7,0,0,6,3, .."

Without times in a CSV, frames get those of the board's counter, from 0. `ti_stream`
parses the stream; a .cfg as description gives the velocities of SDK 1 and 2.
"""

import csv
import datetime
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.errors import parsing
from jradar.files import open_file, read_text
from jradar.recordings.descriptions import read_description
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.ti_stream import (
    DECIBELS,
    FORWARD,
    MAGIC,
    Packet,
    Parser,
    no_velocities,
    packet_points,
)
from jradar.recordings.recording import Format, Recording, Stream

SUFFIXES = (".dat", ".bin", ".csv", ".raw")
BEGIN_BYTES = 64 << 10  # in which a file's first packet ends
MAX_BYTES, MAX_CSV_BYTES = 8 << 30, 1 << 30
PIECE = 1 << 20
CYCLES_HZ, CYCLES_BITS = 200e6, 32  # of the counter in a packet's header
TEXT_MAGIC = re.compile(r"\b2, ?1, ?4, ?3, ?6, ?5, ?8, ?7\b")
STEP_S = (1e-3, 20.0)  # between frames, by the counter


class Source(NamedTuple):
    """The packets of a file, without their TLVs, and how to read a part of it again."""

    packets: list[Packet]
    lost_bytes: int
    read: Callable[[int, int], bytes]  # so many bytes from a place


def open_ti_serial(
    path: Path | str,
    description: Path | str | None = None,
    *,
    device: str | None = None,
) -> Recording:
    """Open the points in a saved stream; frames are decoded when they are accessed.

    Raises ValueError for a stream without packets, and one with points of other demos.
    """
    path, radar, step = Path(path), None, None
    if description is not None:
        found = read_description(description, device=device)
        radar = found.capture.radar(found.radar)
        step = found.radar.velocity_resolution_mps
    source = _csv(path) if path.suffix == ".csv" else _binary(path)
    if not source.packets:
        raise ValueError(f"{path} holds no whole packet of a TI demo")

    def read(index: int) -> dict[str, np.ndarray]:
        packet, parser = source.packets[index], Parser()
        data = source.read(packet.start, packet.size)
        (whole,) = parser.feed(data) or parser.finish() or [None]
        if whole is None:
            raise ValueError(f"{path} changed while it was read: open it again")
        try:
            return packet_points(whole, velocity_step_mps=step)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error

    stamps, notes = _stamps(source.packets)
    frames = Stream(read, len(source.packets), stamps, (*notes, *_notes(source, step)))
    recording = points_recording(path, frames, forward=FORWARD, decibels=DECIBELS)
    return recording if radar is None else recording._replace(radar=radar)


def is_ti_serial(path: Path) -> bool:
    """True for a file that begins with TI's packets, or soon comes to one."""
    if path.suffix not in SUFFIXES or not path.is_file():
        return False
    try:
        with open_file(path) as file:
            begin = file.read(BEGIN_BYTES)
    except (OSError, ValueError):
        return False
    if path.suffix == ".csv":
        return TEXT_MAGIC.search(begin.decode("ascii", "replace")) is not None
    parser = Parser()
    return MAGIC in begin and bool(parser.feed(begin) or parser.finish())


READER = Format(
    "the saved serial stream of a TI demo: .dat, .bin, or bytes in a .csv",
    is_ti_serial,
    open_ti_serial,
    ("description", "device"),
)


def _binary(path: Path) -> Source:
    parser, packets = Parser(), []
    with open_file(path, limit=MAX_BYTES) as file:
        while piece := file.read(PIECE):
            packets += [p._replace(parts=()) for p in parser.feed(piece)]
    packets += [p._replace(parts=()) for p in parser.finish()]

    def read(start: int, size: int) -> bytes:
        with open_file(path) as file:
            file.seek(start)
            return file.read(size)

    return Source(packets, parser.lost_bytes, read)


def _csv(path: Path) -> Source:
    parser, packets, whole = Parser(), [], bytearray()
    lines = read_text(path, limit=MAX_CSV_BYTES).splitlines()
    with parsing(path, "a .csv of the bytes of packets"):
        for row in csv.reader(lines):
            cells = [cell for cell in row if TEXT_MAGIC.search(cell)]
            if not cells:  # the head, or bytes of no packet
                continue
            data = bytes(map(int, cells[0].strip("[] ").split(",")))
            whole += data
            times = [time for cell in row if (time := _seconds(cell)) is not None]
            found = parser.feed(data, stamp_s=times[0] if times else None)
            packets += [p._replace(parts=()) for p in found]
        packets += [p._replace(parts=()) for p in parser.finish()]
    return Source(
        packets, parser.lost_bytes, lambda at, size: bytes(whole[at : at + size])
    )


def _seconds(text: str) -> float | None:
    """Return the time in a cell, seconds or a date in UTC; None for something else."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        time = datetime.datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    utc = time if time.tzinfo else time.replace(tzinfo=datetime.UTC)
    return utc.timestamp()


def _stamps(
    packets: list[Packet],
) -> tuple[Float[np.ndarray, " frame"] | None, tuple[str, ...]]:
    """Return the times of arrival, or else those of the board's counter; and a note."""
    arrived = [packet.stamp_s for packet in packets]
    if all(stamp is not None for stamp in arrived):
        return np.array(arrived, float), ()
    cycles = np.array([packet.cycles for packet in packets], np.int64)
    steps = np.diff(cycles) % (1 << CYCLES_BITS) / CYCLES_HZ
    if len(steps) and STEP_S[0] < np.median(steps) < STEP_S[1] and steps.all():
        note = "times are those of the board's counter, from 0 at the first frame"
        return np.append(0.0, steps.cumsum()), (note,)
    return None, ("the frames have no times: the board's counter does not count",)


def _notes(source: Source, step: float | None) -> tuple[str, ...]:
    first, notes = source.packets[0], ()
    if source.lost_bytes:
        notes += (f"{source.lost_bytes:,} bytes belong to no whole packet",)
    numbers = np.array([packet.frame for packet in source.packets], np.int64)
    if (missing := int(np.maximum(np.diff(numbers) - 1, 0).sum())) and first.frame:
        notes += (f"{missing} frames are missing, by the numbers of those there are",)
    if any(packet.subframe for packet in source.packets):
        notes += ("sub-frames of one frame are separate frames here",)
    return (*notes, *no_velocities(first, step))
