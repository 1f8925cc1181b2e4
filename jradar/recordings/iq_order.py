"""The order of in-phase (I) and quadrature (Q) numbers in the samples of TI radars.

Samples are int16 in the order [chirp][tx][rx][sample]; an `iq_order` is one of

    IIQQ  QQII  IQIQ  QIQI    two lanes (xWR16xx, 18xx, 68xx): four numbers hold two
                              samples
    I4Q4  Q4I4                four lanes (xWR12xx, 14xx): I of every receiver, then Q
                              of every receiver, sample by sample

The orders that begin with Q come from the sample swap of `adcbufCfg`. `reorderEnable`
of a DCA1000 turns IIQQ into IQIQ.
"""

import numpy as np
from jaxtyping import Complex, Int16

from jradar.errors import UsageError
from jradar.radar import RadarSpec

IQ_ORDERS = ("IIQQ", "QQII", "IQIQ", "QIQI", "I4Q4", "Q4I4")
TWO_LANES = IQ_ORDERS[:4]
OTHER_INTERLEAVE = {"IIQQ": "IQIQ", "IQIQ": "IIQQ", "QQII": "QIQI", "QIQI": "QQII"}


def check_iq_order(order: str, radar: RadarSpec) -> None:
    """Raise UsageError for an unknown order, ValueError for one that does not fit."""
    if order not in IQ_ORDERS:
        raise UsageError(
            f"iq_order = {order!r}, expected one of {', '.join(IQ_ORDERS)}"
        )
    if order in TWO_LANES and radar.num_samples % 2:
        raise ValueError(
            f"{radar.num_samples} samples per chirp in the order {order}, expected an "
            "even number: it stores two samples together"
        )


def cube_of_words(
    words: Int16[np.ndarray, " word"], radar: RadarSpec, order: str
) -> Complex[np.ndarray, "tx rx chirp sample"]:
    """Convert one frame of int16 to complex64 [tx, rx, chirp, sample]."""
    tx, rx, chirps, samples = radar.cube_shape
    cube = np.empty(radar.cube_shape, np.complex64)
    if order in TWO_LANES:
        shape = (chirps, tx, rx, samples)
        cube.real, cube.imag = (
            half.reshape(shape).transpose(1, 2, 0, 3) for half in _halves(words, order)
        )
    else:
        halves = words.reshape(chirps, tx, samples, 2, rx).transpose(3, 1, 4, 0, 2)
        cube.real, cube.imag = halves if order == "I4Q4" else halves[::-1]
    return cube


def advise_iq_order(
    words: Int16[np.ndarray, "chirp word"], *, order: str
) -> str | None:
    """Return advice if the spectra of two-lane chirps contradict `order`, else None.

    A wrong interleave mirrors every echo about the middle of the range axis. Swapped
    I and Q reverse the range axis: the notch of the decimation filter, at the far end
    of complex 1x samples, appears at the near end. Differences below 3 dB are ignored.
    """
    num_samples = words.shape[1] // 2
    if order not in TWO_LANES or num_samples % 2 or num_samples < 64:
        return None
    levels = {name: _levels(words, name) for name in TWO_LANES}
    best, other = order, OTHER_INTERLEAVE[order]
    if levels[other][0] > levels[order][0] + 3:
        best = other
    _, near, far = levels[best]
    if near < far - 3:
        best = best[::-1]
    if best == order:
        return None
    return (
        f"the spectra suggest samples in the order {best}, they were read as {order}: "
        f"check whether iq_order='{best}' puts the echoes where they belong"
    )


def _levels(words, order):
    """Return asymmetry about the range axis' middle, near and far level, in dB."""
    in_phase, quadrature = _halves(words[:256].astype(np.float32), order)
    samples = in_phase + 1j * quadrature
    samples -= samples.mean(-1, keepdims=True)
    count = samples.shape[-1]
    power = np.abs(np.fft.fft(samples * np.hanning(count))) ** 2
    level = 10 * np.log10(power.mean(0) + 1e-9)
    bins = np.arange(1, count // 2)
    contrast = np.median(np.abs(level[bins] - level[-bins]))
    edge = slice(count // 50, max(count // 12, 2))
    return contrast, np.median(level[edge]), np.median(level[::-1][edge])


def _halves(words, order):
    """Return I and Q numbers `[..., sample]` of a two-lane device."""
    fours = words.reshape(*words.shape[:-1], -1, 4)
    places = ([at for at in range(4) if order[at] == half] for half in "IQ")
    return [fours[..., at].reshape(*words.shape[:-1], -1) for at in places]
