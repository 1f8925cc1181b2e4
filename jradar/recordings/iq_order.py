"""How in-phase and quadrature numbers alternate in the samples of TI radars.

Samples are int16 in the order [chirp][tx][rx][sample]; an `iq_order` is one of

    IIQQ  QQII  IQIQ  QIQI    two lanes (xWR16xx, 18xx, 68xx): four numbers hold two
                              samples
    I4Q4  Q4I4                four lanes (xWR12xx, 14xx): I of every receiver, then Q
                              of every receiver, sample by sample

The second of each pair is `adcbufCfg`'s sample swap; IQIQ is what `reorderEnable` of a
DCA1000 makes of IIQQ.
"""

import numpy as np
from jaxtyping import Complex, Int16

from jradar.radar import RadarSpec

IQ_ORDERS = ("IIQQ", "QQII", "IQIQ", "QIQI", "I4Q4", "Q4I4")
TWO_LANES = IQ_ORDERS[:4]
OTHER_INTERLEAVE = {"IIQQ": "IQIQ", "IQIQ": "IIQQ", "QQII": "QIQI", "QIQI": "QQII"}


def check_iq_order(order: str, radar: RadarSpec) -> None:
    """ValueError for an order that is unknown or needs an even number of samples."""
    if order not in IQ_ORDERS:
        raise ValueError(
            f"iq_order = {order!r}, expected one of {', '.join(IQ_ORDERS)}"
        )
    if order in TWO_LANES and radar.num_samples % 2:
        raise ValueError(
            f"{radar.num_samples} samples per chirp in the order {order}: two samples "
            "lie together, expected an even number"
        )


def cube_of_words(
    words: Int16[np.ndarray, " word"], radar: RadarSpec, order: str
) -> Complex[np.ndarray, "tx rx chirp sample"]:
    """One frame of int16 as complex64 [tx, rx, chirp, sample]."""
    tx, rx, chirps, samples = radar.cube_shape
    cube = np.empty(radar.cube_shape, np.complex64)
    if order in ("I4Q4", "Q4I4"):
        halves = np.moveaxis(words.reshape(chirps, tx, samples, 2, rx), 3, 0)
        in_phase, quadrature = (
            half.transpose(1, 3, 0, 2)
            for half in (halves if order == "I4Q4" else halves[::-1])
        )
    else:
        in_phase, quadrature = (
            half.reshape(chirps, tx, rx, samples).transpose(1, 2, 0, 3)
            for half in _halves(words, order)
        )
    cube.real, cube.imag = in_phase, quadrature
    return cube


def advise_iq_order(
    words: Int16[np.ndarray, "chirp word"], *, order: str
) -> str | None:
    """What chirps of a two-lane device say about `order`; None where it seems right.

    A wrong interleave gives every echo a mirror image about the middle of the range
    axis. Halves that are swapped turn the range axis about: the notch of the decimation
    filter at the far end of complex 1x samples shows at the near end. Both are believed
    from a difference of 3 dB on.
    """
    num_samples = words.shape[1] // 2
    if order not in TWO_LANES or num_samples % 2 or num_samples < 64:
        return None
    levels = {name: _levels(words, name) for name in TWO_LANES}
    best = order
    other = OTHER_INTERLEAVE[order]
    if levels[other][0] > levels[order][0] + 3:
        best = other
    _, near, far = levels[best]
    if near < far - 3:
        best = best[::-1]
    if best == order:
        return None
    return (
        f"the spectra look like those of samples in the order {best}, they were read "
        f"as {order}: see whether iq_order='{best}' puts the echoes where they belong"
    )


def _levels(words, order):
    """In dB: contrast about the middle of the range axis, level near, level far."""
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
    """In-phase and quadrature numbers `[..., sample]` of a two-lane device."""
    fours = words.reshape(*words.shape[:-1], -1, 4)
    places = ([at for at in range(4) if order[at] == half] for half in "IQ")
    return [fours[..., at].reshape(*words.shape[:-1], -1) for at in places]
