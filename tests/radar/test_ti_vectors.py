"""One frame of an office that TI captured, with the results of TI's own library.

`mmwavelib`'s unit test compares its fixed-point results with those of the file: 12
counts for the range FFT, 0.8 dB for sums of logarithms. Windows are rectangular.
"""

import numpy as np
import pytest

from jradar.radar import noise_floor, range_doppler

PLAIN = {"range_window": "none", "doppler_window": "none"}
WINDOW = {"guard": (0, 4), "train": (0, 8), "edge": "one_sided"}
CHIRPS, BINS = 32, 256
FFT_SCALE, LOG_SCALE = 8, 256  # TI's FFT is divided by 8; logs have 8 fractional bits
TARGET = 0, 13  # TI's object, in Doppler and range
# TI's log of the test, from logs of its own FFT: peak, and noise of each detector.
PEAK, NOISE = 19956, {"ca": 15042, "so": 14967, "go": 15117}


@pytest.fixture(scope="module")
def office(samples):
    """Samples, range FFT and sum of logs over antennas, `[doppler, range]`."""
    content = (samples / "ti_mmwavelib" / "radarDemo_captured_test.bin").read_bytes()
    windows, rest = content[: 128 * 2 + 16 * 4], content[128 * 2 + 16 * 4 :]
    assert set(np.frombuffer(windows[:256], "<i2")) == {32767}  # no window
    size = 2 * CHIRPS * BINS * 4 + BINS * CHIRPS * 2
    antennas = [np.frombuffer(rest, "<i2", size // 2, k * size) for k in range(4)]
    words = np.stack([a[: 4 * CHIRPS * BINS] for a in antennas])
    words = words.reshape(4, CHIRPS, 2, BINS, 2)
    sums = np.frombuffer(rest, "<u2", BINS * CHIRPS, 4 * size)
    return words[:, :, 0], words[:, :, 1] @ [1, 1j], sums.reshape(BINS, CHIRPS).T


def test_range_ffts_are_those_of_ti(office):
    pairs, ranges, _ = office
    cubes = pairs.swapaxes(0, 1)[:, None, :, None]  # each chirp as a frame
    found = np.asarray(range_doppler(cubes, **PLAIN)[0])[:, :, 0] * BINS / FFT_SCALE
    difference = (found.swapaxes(0, 1) - ranges)[..., 1:]  # TI's bin 0 has an offset
    assert max(abs(difference.real).max(), abs(difference.imag).max()) < 12
    assert np.abs(ranges).max() > 1000


def test_sums_over_antennas_and_the_peak_are_those_of_ti(office):
    pairs, _, sums = office
    spectrum = np.asarray(range_doppler(pairs[None], **PLAIN)[0])
    spectrum = np.fft.ifftshift(spectrum, 1) * BINS * CHIRPS / FFT_SCALE
    found = LOG_SCALE * np.log2(np.abs(spectrum)).sum(0)
    strong = sums > 8000  # TI compares no others
    strong[0] = False  # nor Doppler bin 0 ...
    assert strong.mean() > 0.2 and np.abs(found - sums)[strong].max() < 205
    assert np.unravel_index(found.argmax(), found.shape) == TARGET  # ... but its peak
    assert found[TARGET] == pytest.approx(PEAK, abs=10)


@pytest.mark.parametrize("kind", NOISE)
def test_noise_and_threshold_are_those_of_ti(office, kind):
    """TI adds its threshold to the noise: one below the target's gap finds it alone."""
    sums = office[2].astype(np.float32)
    floors = np.asarray(noise_floor(sums, kind=kind, **WINDOW))
    floor, column = floors[TARGET], sums[0]
    low, high = column[13 - 12 : 13 - 4].mean(), column[13 + 5 : 13 + 13].mean()
    noise = {"ca": (low + high) / 2, "so": min(low, high), "go": max(low, high)}
    assert floor == pytest.approx(noise[kind])
    # TI's noise is that of its rounded FFT, higher by 0.5 dB, and alike for all kinds.
    assert floor == pytest.approx(NOISE[kind], abs=90)
    assert floor - noise["ca"] == pytest.approx(NOISE[kind] - NOISE["ca"], abs=1)
    gap = column[13] - floor
    assert np.flatnonzero(column > floors[0] + gap - 1).tolist() == [13]
