"""Raw samples of a TI DCA1000 capture card, read one frame at a time.

    adc_data.bin                 samples alone, as mmWave Studio leaves them
    <prefix>_Raw_<i>.bin         packets with headers of 14 bytes, in several parts
    a dump of UDP payloads       packets with headers of 10 bytes

Samples are little-endian int16, complex, in the order [frame][chirp][tx][rx][sample];
how their two halves alternate: see `iq_order`. Files of `dataLoggingMode` multi are
refused.
"""

import itertools
import re
from pathlib import Path

import numpy as np
from jaxtyping import Complex

from jradar.recordings.dca1000_packets import (
    PAYLOAD,
    Files,
    Packets,
    header_size,
    index_packets,
    lost_per_frame,
)
from jradar.recordings.iq_order import (
    advise_iq_order,
    check_iq_order,
    cube_of_words,
)
from jradar.recordings.recording import Recording, Stream
from jradar.recordings.studio_log import radar_from_studio_log
from jradar.recordings.text_files import radar_from_toml
from jradar.recordings.ti_cfg import CaptureSpec, radar_from_cfg

USUAL = {  # of a frame: what a wrong description may have to be changed to
    "samples": (64, 128, 200, 250, 256, 512, 1024),
    "chirps": (1, 16, 32, 64, 96, 100, 128, 255, 256),
    "rx": (1, 2, 3, 4),
    "tx": (1, 2, 3),
}
PCAP = "a packet trace: extract the UDP payloads, or record with TI's command line"
SEPARATED = "data-separated: set dataLoggingMode to raw and record again"
FOREIGN = {  # how files that are no captures begin
    b"\xd4\xc3\xb2\xa1": PCAP,
    b"\x0a\x0d\x0d\x0a": PCAP,
    b"\xda\x0c\xdc\x0a": SEPARATED,
    b"\xdc\x0a\xda\x0c": SEPARATED,
}


def open_dca1000(
    path: Path | str,
    description: Path | str,
    *,
    iq_order: str | None = None,
    allow_partial: bool = False,
    device: str = "awr1843",
) -> Recording:
    """A capture and its radar: a `.cfg` (for `device`), a `.toml`, or a Studio log.

    `path` names one of the files where a capture is split. `iq_order` replaces what the
    description says. Bytes that were lost on the way are zeros, counted per frame in
    `lost_bytes`. Raises ValueError where the bytes are not a whole number of frames, or
    under `allow_partial` where there is no whole frame.
    """
    files, name = _files(Path(path))
    radar, capture = _radar(Path(description), device)
    if capture and capture.has_headers:
        raise ValueError(
            f"{description}: lvdsStreamCfg puts headers between the chirps, expected 0 "
            "as its second field: record without them"
        )
    order = iq_order or _described_order(capture)
    check_iq_order(order, radar)
    frame_bytes = 4 * int(np.prod(radar.cube_shape))
    header_bytes = header_size(files)
    source = files
    if header_bytes:
        source = index_packets(files, header_bytes, allow_partial=allow_partial)
    count, rest = divmod(source.size, frame_bytes)
    if not count or (rest and not allow_partial):
        raise ValueError(_does_not_fit(files, source.size, radar))

    def read(index: int) -> Complex[np.ndarray, "tx rx chirp sample"]:
        raw = source.read(index * frame_bytes, (index + 1) * frame_bytes)
        return cube_of_words(raw.view("<i2"), radar, order)

    notes = [f"{len(files.paths)} files were joined"] if len(files.paths) > 1 else []
    if rest:
        notes.append(f"the last {rest:,} bytes, less than a frame, were left out")
    lost = None
    if isinstance(source, Packets):
        lost = lost_per_frame(source, frame_bytes, count)
        notes += _losses(source, lost)
    whole = int(lost.argmin()) if lost is not None else 0
    words = source.read(whole * frame_bytes, (whole + 1) * frame_bytes).view("<i2")
    if advice := advise_iq_order(words.reshape(-1, 2 * radar.num_samples), order=order):
        notes.append(advice)
    period = radar.frame_period_s
    factors = capture.channel_factors if capture else ()
    return Recording(
        name=name,
        path=Path(path),
        radar=radar,
        cubes=Stream(read, count, np.arange(count) * period if period else None),
        channel_factors=np.array(factors, np.complex64) if set(factors) - {1} else None,
        range_bias_m=capture.range_bias_m if capture else 0.0,
        lost_bytes=lost,
        notes=tuple(notes),
    )


def _files(path):
    """All files of the capture that `path` belongs to, and its name."""
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


def _radar(description, device):
    """The radar and, of a `.cfg`, how its samples are streamed."""
    if not description.is_file():
        raise FileNotFoundError(f"no such radar description: {description}")
    if description.suffix == ".cfg":
        radar = radar_from_cfg(description, device=device)
        return radar, CaptureSpec.from_cfg(description)
    if description.suffix == ".toml":
        return radar_from_toml(description), None
    return radar_from_studio_log(description), None


def _described_order(capture):
    """The order of halves of a `.cfg`; mmWave Studio does not swap them."""
    if not capture:
        return "IIQQ"
    orders = ("I4Q4", "Q4I4") if capture.interleaved else ("IIQQ", "QQII")
    return orders[capture.sample_swap]


def _losses(packets, lost):
    """Notes on bytes that were lost, came twice or came late."""
    first, last = packets.holes()
    missing = int((last - first).sum())
    again = int((packets.payload * packets.number).sum()) - packets.size + missing
    late = np.count_nonzero(np.diff(packets.offset) < 0)
    if missing:
        yield (
            f"{missing:,} bytes ({-(-missing // PAYLOAD):,} packets) were lost, in "
            f"{np.count_nonzero(lost):,} of {len(lost):,} frames: zeros in their place"
        )
    if again:
        yield f"{again:,} bytes came more than once"
    if late:
        yield f"packets were out of order in {late:,} places: put back"


def _does_not_fit(files, size, radar):
    """The error of a size that is not a multiple of a frame's."""
    tx, rx, chirps, samples = radar.cube_shape
    frame_bytes = 4 * tx * rx * chirps * samples
    mine = (samples, chirps, rx, tx)
    usual = (sorted({*USUAL[k], v}) for k, v in zip(USUAL, mine, strict=True))
    fitting = [
        shape
        for shape in itertools.product(*usual)
        if size and size % (4 * int(np.prod(shape))) == 0
    ]
    fitting.sort(
        key=lambda shape: (
            sum(a != b for a, b in zip(shape, mine, strict=True)),
            -np.prod(shape),
        )
    )
    others = (
        "or another capture's description: what would fit are (samples, chirps, rx, "
        f"tx) of {fitting[:6]}"
        if fitting
        else "no usual frame fits either"
    )
    return (
        f"{files.paths[0]} holds {size:,} bytes, {radar.name} needs a multiple of "
        f"{frame_bytes:,} ({chirps} chirps x {tx} tx x {rx} rx x {samples} samples x 4 "
        f"bytes): {size // frame_bytes} whole frames; truncated (allow_partial reads "
        f"the whole ones)? {others}"
    )
