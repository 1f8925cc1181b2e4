"""Raw samples of a TI DCA1000 capture card, read one frame at a time.

    adc_data.bin                 samples only, as mmWave Studio writes them
    <prefix>_Raw_<i>.bin         packets with headers of 14 bytes, in several files
    a dump of UDP payloads       packets with headers of 10 bytes

Samples are little-endian int16 in the order [frame][chirp][tx][rx][sample]; `iq_order`
describes how I and Q alternate. Files recorded with `dataLoggingMode` multi
cannot be read.
"""

import dataclasses
import itertools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float, Num

from jradar.errors import UsageError
from jradar.options.sensor import RadarSpec
from jradar.recordings.descriptions import (
    Description,
    find_description,
    frame_stamps,
    read_description,
)
from jradar.recordings.recording import Format, Recording, Stream
from jradar.recordings.ti import lanes
from jradar.recordings.ti.iq_order import (
    TWO_LANES,
    advise_iq_order,
    check_iq_order,
    cube_of_words,
)
from jradar.recordings.ti.packets import (
    PAYLOAD,
    Files,
    Packets,
    header_size,
    index_packets,
    lost_per_frame,
)

DESCRIPTION_NAMES = (
    *("*LogFile*.txt", "*LogFile*.csv", "*.lua"),
    *("*.cfg", "*.json", "*.toml"),
)
USUAL = {  # sizes of a frame, suggested where a description does not fit
    "samples": (64, 128, 200, 250, 256, 512, 1024),
    "chirps": (1, 16, 32, 64, 96, 100, 128, 255, 256),
    "rx": (1, 2, 3, 4),
    "tx": (1, 2, 3),
}
MORE_FRAMES = (
    "the description asks for {} frames, and the capture holds {}: is it of another "
    "run, or do its frames have more chirps (loops) than {} for each transmitter?"
)
LOOKED_AT = 5  # frames that may show whether samples are missing
PCAP = "a packet trace: name it .pcap or .pcapng"
SEPARATED = "data-separated: set dataLoggingMode to raw and record again"
FOREIGN = {  # first bytes of files that are not captures
    b"\xd4\xc3\xb2\xa1": PCAP,
    b"\x0a\x0d\x0d\x0a": PCAP,
    b"\xda\x0c\xdc\x0a": SEPARATED,
    b"\xdc\x0a\xda\x0c": SEPARATED,
}


def open_dca1000(
    path: Path | str,
    description: Path | str | None = None,
    *,
    iq_order: str | None = None,
    allow_partial: bool = False,
    device: str | None = None,
) -> Recording:
    """Open a capture with its radar: a mmWave Studio log, a `.cfg` or a `.toml`.

    By default the only description next to `path` is used. A capture in several files
    is named by one of them. `iq_order` replaces the described order of I and Q;
    `device` is the board of a `.cfg`. Lost bytes are read as zeros and counted per
    frame in `lost_bytes`. Raises ValueError if the bytes are not a whole number of
    frames, or, with `allow_partial`, if there is no whole frame.
    """
    path = Path(path)
    if description is None and "adc_samples" in path.parts:
        raise UsageError(
            f"{path} looks like one frame of ColoRadar: name the folder of its "
            "sequence, and the frame with --frame"
        )
    files, name = _files(path)
    described = described_samples(path, description, iq_order=iq_order, device=device)
    header_bytes = header_size(files)
    source = files
    if header_bytes:
        source = index_packets(files, header_bytes, allow_partial=allow_partial)
    return recording_of_samples(
        path, name, source, described, allow_partial=allow_partial
    )


def described_samples(
    path: Path,
    description: Path | str | None,
    *,
    iq_order: str | None = None,
    device: str | None = None,
) -> Description:
    """Return the radar of a stream of samples, checked, with its order of I and Q.

    `path` is the file of samples, which errors name. By default its description is the
    only one next to it.
    """
    description = description or find_description(path, DESCRIPTION_NAMES)
    found = read_description(description, device=device)
    return checked_samples(path, description, found, iq_order=iq_order)


def checked_samples(
    path: Path,
    description: Path | str,
    found: Description,
    *,
    iq_order: str | None = None,
) -> Description:
    """Return a description with the order of I and Q of the samples in `path`.

    `description` is where it was found. Raises ValueError if it does not fit them.
    """
    if found.capture.has_headers:
        raise ValueError(
            f"{description}: lvdsStreamCfg puts headers between the chirps: set its "
            "second field to 0 and record again"
        )
    real = found.radar.real_samples
    order = iq_order or ("I" if real else found.capture.iq_order)
    check_iq_order(path, order, found.radar)
    return found._replace(capture=dataclasses.replace(found.capture, iq_order=order))


def recording_of_samples(
    path: Path,
    name: str,
    source: Files | Packets,
    described: Description,
    *,
    allow_partial: bool = False,
    stamps: Float[np.ndarray, " frame"] | None = None,
) -> Recording:
    """Return the recording whose samples `source` holds, frame after frame.

    Without `stamps`, frames follow one another in the radar's frame period. Errors as
    in `open_dca1000`.
    """
    radar, capture, warnings = described
    order, missing = capture.iq_order, None
    if lanes.may_be_halved(radar, capture.lanes, order):
        missing = _missing(source, described)
        radar = lanes.halved(radar) if missing else radar
        warnings = (*warnings, lanes.note(radar, missing))
    frame_bytes = bytes_of_frame(radar)
    count, rest = divmod(source.size, frame_bytes)
    if not count or (rest and not allow_partial):
        misfit = _does_not_fit(path, source.size, radar)
        raise ValueError(" ".join([misfit, *warnings]))

    if stamps is None:
        stamps = frame_stamps(path, count, radar.frame_period_s)

    def read(index: int) -> Num[np.ndarray, "tx rx chirp sample"]:
        raw = source.read(index * frame_bytes, (index + 1) * frame_bytes)
        cube = cube_of_words(raw.view("<i2"), radar, order)
        return lanes.restored(cube) if missing else cube

    notes, lost, whole = [*warnings], None, 0
    if isinstance(source, Files) and len(source.paths) > 1:
        notes.append(f"{len(source.paths)} files were joined")
    if 0 < capture.frames < count and count % capture.frames == 0:
        notes.append(MORE_FRAMES.format(capture.frames, count, radar.num_chirps))
    if rest:
        notes.append(f"the last {rest:,} bytes, less than a frame, were left out")
    if isinstance(source, Packets):
        lost = lost_per_frame(source, frame_bytes, count)
        notes += _losses(source, lost)
        whole = int(lost.argmin())
    if missing is not True:
        seen = read(whole)
        if advice := advise_iq_order(seen, order=order):
            notes.append(advice)
        elif order in TWO_LANES and lanes.samples_missing(seen):
            notes.append(lanes.ADVICE)
    return Recording(
        name=name,
        path=path,
        radar=capture.radar(radar),
        cubes=Stream(read, count, None if stamps is None else stamps[:count]),
        lost_bytes=lost,
        base_from_radar=capture.base_from_radar(),
        iq_order=order,
        lanes=capture.lanes if missing else 0,
        notes=tuple(notes),
    )


READER = Format(
    "an adc_data.bin of a DCA1000 with its mmWave Studio log, .cfg or .toml",
    lambda path: path.suffix == ".bin",
    open_dca1000,
    ("description", "iq_order", "allow_partial", "device"),
)


def _files(path: Path) -> tuple[Files, str]:
    """Return all files of the capture that `path` belongs to, and its name."""
    split = re.fullmatch(r"(.+)_Raw_(\d+)\.bin", path.name)
    if re.search(r"_hdr_0", path.name):
        raise ValueError(f"{path} is {SEPARATED}")
    if not path.is_file():
        raise FileNotFoundError(f"no such file: {path}")
    paths, name = [path], path.stem
    if split:
        name, pattern = split[1], re.compile(rf"{re.escape(split[1])}_Raw_(\d+)\.bin")
        found = [(pattern.fullmatch(file.name), file) for file in path.parent.iterdir()]
        numbered = sorted((int(match[1]), file) for match, file in found if match)
        numbers, paths = [n for n, _ in numbered], [file for _, file in numbered]
        if numbers != [*range(len(numbers))]:
            raise ValueError(
                f"{path.parent} holds the parts {numbers} of {name}, expected "
                f"0 to {numbers[-1]}, each once"
            )
    files = Files.of(paths)
    begin = files.read(0, 64).tobytes()
    for magic, what in FOREIGN.items():
        inside = what == SEPARATED and begin.find(magic) % 2 == 0
        if begin.startswith(magic) or inside:
            raise ValueError(f"{path} is {what}")
    return files, name


def _missing(source: Files | Packets, described: Description) -> bool:
    """Return whether every other pair of samples is missing, of four lanes.

    The first frames that show it decide, or else whether all bytes are there.
    """
    radar, capture, _ = described
    stored = lanes.halved(radar)
    size = bytes_of_frame(stored)
    for index in range(min(source.size // size, LOOKED_AT)):
        words = source.read(index * size, (index + 1) * size).view("<i2")
        cube = cube_of_words(words, stored, capture.iq_order)
        if (found := lanes.samples_missing(cube)) is not None:
            return found
    asked = capture.frames * bytes_of_frame(radar)
    return not asked or source.size < asked


def bytes_of_frame(radar: RadarSpec) -> int:
    """Return the bytes of a frame: 16 bits for each number."""
    return (2 if radar.real_samples else 4) * math.prod(radar.cube_shape)


def _losses(packets: Packets, lost: np.ndarray) -> Iterator[str]:
    first, last = packets.holes()
    missing = int((last - first).sum())
    again = int(packets.sizes.sum()) - packets.size + missing
    late = np.count_nonzero(np.diff(packets.offset) < 0)
    if missing:
        yield (
            f"{missing:,} bytes ({-(-missing // PAYLOAD):,} packets) were lost, in "
            f"{np.count_nonzero(lost):,} of {len(lost):,} frames: read as zeros"
        )
    if again:
        yield f"{again:,} bytes arrived more than once"
    if late:
        yield f"packets were out of order in {late:,} places: reordered"


def _does_not_fit(path: Path, size: int, radar: RadarSpec) -> str:
    tx, rx, chirps, samples = radar.cube_shape
    frame_bytes = bytes_of_frame(radar)
    sample_bytes = frame_bytes // math.prod(radar.cube_shape)
    mine = (samples, chirps, rx, tx)
    usual = (sorted({*USUAL[k], v}) for k, v in zip(USUAL, mine, strict=True))

    def least_changed(shape):
        changed = sum(a != b for a, b in zip(shape, mine, strict=True))
        return changed, -math.prod(shape)

    shapes = itertools.product(*usual)
    shapes = [s for s in shapes if not size % (sample_bytes * math.prod(s))]
    fitting = sorted(shapes if size else [], key=least_changed)[:6]
    others = f"frames of (samples, chirps, rx, tx) that fit: {fitting}"
    if not fitting:
        others = "no usual frame size fits"
    return (
        f"{path} holds {size:,} bytes, {radar.name} needs a multiple of "
        f"{frame_bytes:,} ({chirps} chirps x {tx} tx x {rx} rx x {samples} samples x "
        f"{sample_bytes} bytes): {size // frame_bytes} whole frames. Was the file cut "
        "off (--allow-partial reads the whole frames), or does the description belong "
        f"to another capture ({others})?"
    )
