"""Checks whether the samples of a frame are read correctly.

    clipped           numbers at the end of the converter's scale: the sum of all echoes
                      was stronger, and its distortion looks like further echoes
    other byte order  big-endian samples read as little-endian
    offset binary     unsigned samples, 0 at the most negative voltage
    other antennas    chirps that repeat with another number of transmitters
    half chirps       the halves of a chirp, each taken for a whole one
    other frames      frames that end elsewhere than described, see `frame_checks`

`check_samples` takes a frame as it was recorded, before any calibration.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int16, Num

from jradar.recordings.frame_checks import frame_warnings
from jradar.recordings.recording import Recording

# Full scale of converters with 16, 14 and 12 bits. TI's chips store all in 16 bits,
# 12 of them at the low or at the high end, where values are multiples of 16.
SCALES = (2**15, 2**13, 2**11)
LARGEST_STEP = 16
# Clipping a share of 1 in 1,000 numbers by a tenth of full scale distorts the signal
# by sqrt(0.001) / 10, 50 dB below full scale: as strong as the weak echoes of a room,
# which lie 40 to 60 dB below the strongest one.
CLIPPED_SHARE = 1e-3
# A tone that just reaches the last of C codes spends arccos(0.9) / pi of its time in
# the last tenth before full scale, and sqrt(2 / C) / pi at the last code; other signals
# spend less. Clipping collects there all that lies beyond: more than twice as much.
# Fewer parts than FEW show nothing.
PILE = 2 * np.sqrt(2) / np.arccos(0.9)
FEW = 10
# Samples in the wrong byte order or code are noise of full scale, 86 dB in 16 bits.
# The right reading has a floor below that by the converter's range over its own noise;
# 10 dB are left even if echoes fill a third of the scale with noise.
FLOOR_DB = 10.0
# Unsigned samples swing about the middle of the scale, to which leakage of the
# transmitter adds a constant of a few per cent.
MIDDLE = 1 / 8
CHIRPS = 256  # whose spectra are compared
# Echoes of chirps from the same antenna agree, but for the phase of motion that all
# share in a range bin; those from different antennas differ in phase by direction.
STRONG_BINS = 8
# One strong echo ahead may differ little: in a real capture by 0.26 of a correlation of
# 1, where the same antennas differ by 0.00001.
AGREE, APART, TIMES = 0.9, 0.1, 5
READINGS = {
    "in the other byte order": (
        lambda words: words.byteswap(),
        "convert the file, in numpy: fromfile(PATH, '>i2').astype('<i2').tofile(NEW)",
    ),
    "in offset binary": (
        lambda words: words ^ np.int16(-(2**15)),
        "convert the file, in numpy: (fromfile(PATH, '<u2') ^ 0x8000).tofile(NEW)",
    ),
    "in offset binary and the other byte order": (
        lambda words: words.byteswap() ^ np.int16(-(2**15)),
        "convert the file, in numpy: (fromfile(PATH, '>u2') ^ 0x8000).astype('<u2')"
        ".tofile(NEW)",
    ),
}


class SampleCheck(NamedTuple):
    """What a frame's samples look like."""

    largest: float  # of the real and imaginary parts, without their sign
    full_scale: int | None  # at which samples pile up, None if they do not
    share: float  # of the parts that lie at full scale
    warnings: tuple[str, ...]  # warnings, with the likely fix


def check_samples(cube: Num[np.ndarray, "tx rx chirp sample"]) -> SampleCheck:
    """Return how far a recorded frame fills the converter's scale, and warnings.

    Frames whose samples are not whole numbers of 16 bits cause no warnings, because
    somebody has scaled them.
    """
    chirps = cube.transpose(2, 0, 1, 3).reshape(-1, cube.shape[-1])
    halves = (np.real, np.imag) if np.iscomplexobj(chirps) else (np.real,)
    parts = np.stack([half(chirps) for half in halves])
    largest = float(np.abs(parts).max())
    if not largest:
        warning = "all samples are zero: did the radar send, and the card receive?"
        return SampleCheck(0.0, None, 0.0, (warning,))
    if not largest < 2**16 or (parts != np.rint(parts)).any():
        return SampleCheck(largest, None, 0.0, ())
    warnings = [*_offset_warnings(parts)]
    full_scale, share = _clipping(parts)
    if parts.min() >= -(2**15) and parts.max() < 2**15:
        warnings += _code_warnings(parts[:, :CHIRPS].astype(np.int16))
    warnings += _antenna_warnings(cube)
    if full_scale and share > CLIPPED_SHARE and not warnings:
        warnings.append(
            f"{share:.1%} of the samples are at full scale ({full_scale - 1:,}): the "
            "receiver is overdriven, and its distortion looks like echoes: lower the "
            "gain (rxGain), or move strong reflectors away"
        )
    return SampleCheck(largest, full_scale, share, tuple(warnings))


def sample_warnings(recording: Recording, frame: int) -> tuple[str, ...]:
    """Return warnings about the samples of a frame."""
    warnings = check_samples(recording.cubes[frame]).warnings
    warnings = warnings or (*frame_warnings(recording, frame),)
    return tuple(f"frame {frame}: {warning}" for warning in warnings)


def with_sample_warnings(recording: Recording, frame: int) -> Recording:
    """Add warnings about the samples of a frame, if any, to a recording's notes."""
    if recording.of_points:
        return recording
    warnings = sample_warnings(recording, frame)
    return recording._replace(notes=(*recording.notes, *warnings))


def _clipping(parts) -> tuple[int | None, float]:
    """Return the full scale at which parts pile up, and their share."""
    scale = min((s for s in SCALES if np.abs(parts).max() <= s), default=0)
    bits = int(np.bitwise_or.reduce(parts.astype(np.int64), axis=None))
    step = min(bits & -bits, LARGEST_STEP)  # the lowest bit that any part uses
    ends = np.abs(parts) >= scale - step
    near = (np.abs(parts) >= 0.9 * scale) & ~ends
    codes = max(scale / step, 1)
    if not scale or ends.sum() <= max(PILE / np.sqrt(codes) * near.sum(), FEW):
        return None, 0.0
    return scale, float(ends.mean())


def _offset_warnings(parts):
    """Yield a warning about numbers that are positive and swing about a half scale."""
    for scale in SCALES:
        aside = np.abs(parts.mean((1, 2)) - scale).max()
        if parts.min() >= 0 and parts.max() < 2 * scale and aside < MIDDLE * scale:
            yield (
                f"all samples are positive and swing about {scale:,}, as unsigned "
                f"numbers do: subtract {scale:,} and save them again"
            )


def _code_warnings(words: Int16[np.ndarray, "part chirp sample"]):
    """Yield a warning if another reading of the words has a far lower noise floor."""
    floors = {name: _floor(change(words)) for name, (change, _) in READINGS.items()}
    best = min(floors, key=lambda name: floors[name])
    below = _floor(words) - floors[best]
    if below > FLOOR_DB:
        yield (
            f"the samples look like numbers {best}, because the noise floor is then "
            f"{below:.0f} dB lower: {READINGS[best][1]}"
        )


def _antenna_warnings(cube):
    """Yield a warning if the chirps repeat with another number of antennas."""
    count = len(cube)
    in_time = np.moveaxis(cube, 2, 0).reshape(-1, *cube.shape[1::2])[:CHIRPS]
    spectra = np.fft.fft(in_time * np.hanning(cube.shape[-1]))
    spectra = spectra[..., 2 : cube.shape[-1] // (1 if np.iscomplexobj(cube) else 2)]
    power = (np.abs(spectra) ** 2).sum((0, 1))
    strong = spectra[..., np.argsort(power)[-STRONG_BINS:]]

    def agreement(chirps):
        late, early = strong[chirps:], strong[: len(strong) - chirps]
        both = np.abs((late * early.conj()).sum((0, 1)))
        alone = np.sqrt(
            (np.abs(late) ** 2).sum((0, 1)) * (np.abs(early) ** 2).sum((0, 1))
        )
        return float(np.median(both / np.maximum(alone, 1e-12)))

    if len(strong) < 12 or not strong.size:
        return
    taken = agreement(count)
    numbers = {2, 3, 2 * count} - {count}
    for number in sorted(n for n in numbers if 4 * n <= len(strong)):
        found = agreement(number)
        if found > AGREE and 1 - taken > max(APART, TIMES * (1 - found)):
            break
    else:
        return
    if number in (2, 3):
        yield (
            f"the chirps repeat after {number}, not after {count} as described: "
            f"targets appear as {number} ghosts; describe the radar with {number} "
            "transmit antennas"
        )
        return
    size = cube.shape[-1]
    yield (
        f"the chirps repeat after {number}, not after {count} as described, as halves "
        "of chirps do: an echo then has several velocities, and wrong ranges; describe "
        f"the radar with {2 * size} samples per chirp instead of {size}, or with twice "
        "as many receivers"
    )


def _floor(words):
    """Return the median of the range spectrum, in dB of the converter's steps."""
    parts = words.astype(np.float32)
    samples = parts[0] + 1j * parts[1] if len(parts) == 2 else parts[0]
    samples = samples - samples.mean(-1, keepdims=True)
    spectra = np.fft.fft(samples * np.hanning(samples.shape[-1]))
    return 10 * np.log10(np.median((np.abs(spectra) ** 2).mean(0)) + 1e-3)
