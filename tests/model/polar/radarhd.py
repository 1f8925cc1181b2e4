"""RadarHD's polar image of one frame, cell by cell on the host.

Written from what RadarHD's `create_dataset_all_radar_lidar.py` computes, and not from
`jradar.model.grids.polar.image`: FFTs and a list of points that are drawn one after
another.
"""

import math

import numpy as np


def drawn(frame):
    """The 8-bit image of samples [antenna, sample] of RadarHD's row.

    Its directions count the other way than jradar's: antennas are in reversed order.
    """
    spectrum = np.fft.fft(np.fft.fft(frame[::-1], 512, axis=1), 64, axis=0)
    magnitude = abs(np.fft.fftshift(spectrum, axes=0))
    strongest = magnitude[:, 6:].max()
    points = []
    for i in range(64):
        sine = 1 - 2 * i / 63
        for k in range(6, 512):
            distance = 21.59 * k / 511
            x, y = distance * math.sqrt(max(1 - sine**2, 0)), distance * sine
            degrees = math.degrees(math.atan2(y, x))
            seen = 0 < x <= 10 and abs(y) <= 10 and abs(degrees) <= 70
            if seen and magnitude[i, k] >= strongest / 20 and math.hypot(x, y) <= 10.8:
                level = 10 * math.log10(magnitude[i, k])
                points.append((math.hypot(x, y), degrees, level))
    image = np.zeros((256, 64))
    if not points:
        return image.astype(np.uint8)
    low, high = (pick(level for *_, level in points) for pick in (min, max))
    for distance, degrees, level in points:
        row = math.ceil(distance / 10.8 * 255)
        column = math.ceil((degrees + 90) / 180 * 63)
        image[row, column] = (level - low) / (high - low)  # the last one stays
    return (255 * image).astype(np.uint8)
