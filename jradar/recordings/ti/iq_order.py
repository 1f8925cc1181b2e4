"""The order of in-phase (I) and quadrature (Q) numbers in the samples of TI radars.

Samples are int16 in the order [chirp][tx][rx][sample]; an `iq_order` is one of

    IIQQ  QQII  IQIQ  QIQI    two lanes (xWR16xx, 18xx, 68xx): four numbers hold two
                              samples
    I4Q4  Q4I4                four lanes (xWR12xx, 14xx): I of every receiver, then Q
                              of every receiver, sample by sample
    I                         real samples (2944)

The orders that begin with Q come from the sample swap of `adcbufCfg`. `reorderEnable`
of a DCA1000 turns IIQQ into IQIQ.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int16, Num

from jradar.errors import UsageError
from jradar.options.recordings import IQ_ORDERS
from jradar.options.sensor import RadarSpec

TWO_LANES = IQ_ORDERS[:4]
OTHER_INTERLEAVE = {"IIQQ": "IQIQ", "IQIQ": "IIQQ", "QQII": "QIQI", "QIQI": "QQII"}
SWAPPED = {"IIQQ": "QQII", "IQIQ": "QIQI", "I4Q4": "Q4I4"}
SWAPPED |= {swapped: order for order, swapped in SWAPPED.items()}
LEAST_SAMPLES = 64  # for a spectrum whose two ends can be distinguished
IMAGE_RATIO = 4.0  # 6 dB; a wrong interleave raises the images by 10 to 30 dB
LEAKAGE_RATIO = 10.0  # the leakage exceeds the far end by 20 dB or more


def check_iq_order(path: Path, order: str, radar: RadarSpec) -> None:
    """Raise UsageError for an unknown order, ValueError for one that does not fit.

    `path` is the file of samples, which the errors name.
    """
    if order not in IQ_ORDERS:
        raise UsageError(
            f"{path}: iq_order = {order!r}, expected one of {', '.join(IQ_ORDERS)}"
        )
    if (order == "I") != radar.real_samples:
        kind, orders = "complex", ", ".join(IQ_ORDERS[:-1])
        if radar.real_samples:
            kind, orders = "real", "I"
        raise ValueError(
            f"{path}: iq_order = {order!r}, but {radar.name} has {kind} samples: "
            f"expected {orders}"
        )
    if order in TWO_LANES and radar.num_samples % 2:
        raise ValueError(
            f"{path}: {radar.num_samples} samples per chirp in the order {order}, "
            "expected an even number: it stores two samples together"
        )


def cube_of_words(
    words: Int16[np.ndarray, " word"], radar: RadarSpec, order: str
) -> Num[np.ndarray, "tx rx chirp sample"]:
    """Convert one frame of int16 to [tx, rx, chirp, sample]: complex64, or float32."""
    return _cube(words, radar.cube_shape, order)


def words_of_cube(
    cube: Num[np.ndarray, "tx rx chirp sample"], radar: RadarSpec, order: str
) -> Int16[np.ndarray, " word"]:
    """Convert a frame to the int16 of a capture card, the inverse of `cube_of_words`.

    Samples are rounded; ValueError beyond 16 bits.
    """
    return _words(np.reshape(cube, radar.cube_shape), order)


def _words(cube: Any, order: str) -> np.ndarray:
    shape, axes = _layout(cube.shape, order)
    parts = [cube.real] if order == "I" else [cube.real, cube.imag]
    rounded, limits = np.rint(parts[:: _step(order)]), np.iinfo(np.int16)
    if not ((rounded >= limits.min) & (rounded <= limits.max)).all():
        raise ValueError(
            f"samples reach {np.abs(rounded).max():.4g}, expected at most "
            f"{limits.max}: a capture card sends 16-bit numbers, scale the recording"
        )
    words = rounded.astype(np.int16).reshape([shape[axis] for axis in axes])
    return words.transpose(np.argsort(axes)).ravel()


def _cube(words: np.ndarray, cube_shape: tuple[int, ...], order: str) -> np.ndarray:
    shape, axes = _layout(cube_shape, order)
    parts = words.reshape(shape).transpose(axes)
    if order == "I":
        return parts[0].astype(np.float32)
    cube = np.empty(parts.shape[1:], np.complex64)
    cube.real, cube.imag = parts[:: _step(order)]
    return cube.reshape(cube_shape)


def _step(order: str) -> int:
    return -1 if order.startswith("Q") else 1  # through the halves I, Q


def _layout(
    cube_shape: tuple[int, ...], order: str
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the shape of the words, and its axes as [half, tx, rx, chirp, sample ..].

    Of two lanes, IIQQ and QQII store two samples together.
    """
    tx, rx, chirps, samples = cube_shape
    if order in ("I4Q4", "Q4I4"):
        return (chirps, tx, samples, 2, rx), (3, 1, 4, 0, 2)
    if order in ("IIQQ", "QQII"):
        return (chirps, tx, rx, samples // 2, 2, 2), (4, 1, 2, 0, 3, 5)
    return (chirps, tx, rx, samples, len({*order})), (4, 1, 2, 0, 3)


def advise_iq_order(
    cube: Num[np.ndarray, "tx rx chirp sample"], *, order: str
) -> str | None:
    """Return advice if the spectrum of a frame contradicts `order`, else None.

    A wrong interleave adds to every echo its image on the other side of the range
    axis' middle, so the right one has the weaker images. Swapped I and Q reverse the
    range axis. Part of the transmitted signal leaks directly into the receivers; it
    stands still and belongs in the first range bins, so that a leakage in the last ones
    shows the reversal. A silent frame, or noise alone, gives no advice.
    """
    if order not in SWAPPED or cube.shape[-1] < LEAST_SAMPLES:
        return None
    best, power = order, _power(cube)
    if other := OTHER_INTERLEAVE.get(order):
        changed = _power(_cube(_words(cube, order), cube.shape, other))
        if _image(changed) * IMAGE_RATIO < _image(power):
            best, power = other, changed
    if _is_reversed(power):
        best = SWAPPED[best]
    if best == order:
        return None
    return (
        f"the spectra suggest samples in the order {best}, they were read as {order}: "
        f"check whether iq_order='{best}' (--iq-order {best}) puts the echoes where "
        "they belong"
    )


def _power(cube):
    """Return the power over range of what stands still, antennas averaged."""
    still = cube.mean(2)
    still = still - still.mean(-1, keepdims=True)
    spectra = np.fft.fft(still * np.hanning(still.shape[-1]))
    return (np.abs(spectra) ** 2).mean((0, 1))


def _image(power):
    """Return the power of images, relative to that of the echoes they belong to."""
    bins = np.arange(2, len(power) // 2)  # without the constant part
    both = np.stack([power[bins], power[-bins]])
    return both.min(0).sum() / max(both.max(0).sum(), 1e-9)


def _is_reversed(power):
    """True if the far end is the stronger one, and falls from the end inwards.

    The last condition separates leakage from an echo a little nearer.
    """
    width = max(len(power) // 32, 4)
    near, far = power[2 : 2 + width], power[::-1][1 : 1 + width]
    return bool(far.sum() > LEAKAGE_RATIO * near.sum() and far[0] > far[3])
