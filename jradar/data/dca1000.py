"""Raw samples of a TI DCA1000 capture card.

`adc_data.bin`, as mmWave Studio writes it for two-lane devices (xWR16xx, 18xx, 68xx),
is little-endian int16 in the order [frame][chirp][tx][rx][sample pair], where a pair
of complex samples is I0 I1 Q0 Q1.
"""

from pathlib import Path

import numpy as np

from jradar.radar import RadarSpec


def read_adc_data(path: Path | str, radar: RadarSpec) -> np.ndarray:
    """Frames [frame, tx, rx, chirp, sample] of a whole `adc_data.bin`, complex64.

    Raises ValueError where the file is not a whole number of frames.
    """
    path = Path(path)
    tx, rx, chirps, samples = radar.cube_shape
    frame_bytes = 4 * tx * rx * chirps * samples
    size = path.stat().st_size
    if size == 0 or size % frame_bytes or samples % 2:
        raise ValueError(
            f"{path} holds {size:,} bytes, {radar.name} needs a multiple of "
            f"{frame_bytes:,} ({chirps} chirps x {tx} tx x {rx} rx x {samples} samples "
            f"x 4 bytes): {size // frame_bytes} whole frames; truncated, or the log of "
            "another recording?"
        )
    raw = np.fromfile(path, "<i2").astype(np.float32)
    pairs = raw.reshape(-1, chirps, tx, rx, samples // 2, 2, 2)
    in_phase, quadrature = pairs[..., 0, :], pairs[..., 1, :]
    frames = (in_phase + 1j * quadrature).reshape(-1, chirps, tx, rx, samples)
    return frames.transpose(0, 2, 3, 1, 4)
