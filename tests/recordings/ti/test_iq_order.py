"""Orders of I and Q: samples and words, and what spectra say of a wrong order."""

import itertools

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings.ti.iq_order import advise_iq_order, cube_of_words, words_of_cube
from tests.recordings.dca1000_writer import TWO_LANES, as_bytes, random_cubes


@pytest.mark.parametrize("order", [*TWO_LANES, "I4Q4", "Q4I4"])
def test_words_of_a_cube_are_those_that_were_read(order):
    radar = RadarSpec.awr1843(num_chirps=5, num_samples=10)
    for cube in random_cubes():
        words = words_of_cube(cube, radar, order)
        assert words.tobytes() == as_bytes([cube], order)
        np.testing.assert_array_equal(cube_of_words(words, radar, order), cube)


def test_words_of_real_samples_and_of_samples_beyond_16_bits():
    radar = RadarSpec.awr1843(num_chirps=5, num_samples=10, real_samples=True)
    cube = random_cubes(1, radar.cube_shape)[0].real
    words = words_of_cube(cube, radar, "I")
    np.testing.assert_array_equal(cube_of_words(words, radar, "I"), cube)
    with pytest.raises(ValueError, match="samples reach 4e.04, expected at most 32767"):
        words_of_cube(0 * cube + 4e4, radar, "I")


def assert_advised(cube, true, read):
    """The true order is named unless it is the one in which the cube was read."""
    advice = advise_iq_order(cube, order=read)
    assert (advice is None) if true == read else (f"in the order {true}" in advice)


@pytest.mark.parametrize("true", TWO_LANES)
@pytest.mark.parametrize("read", TWO_LANES)
def test_advice_on_echoes_above_filtered_noise(true, read):
    rng = np.random.default_rng(1)
    count, bins = 128, np.arange(128)
    spectrum = rng.normal(size=(64, count)) + 1j * rng.normal(size=(64, count))
    spectrum *= np.where(bins > 118, 0.3, 1.0) + 30 * (bins > 3) * (bins < 60)
    spectrum[:, 1:4] += [100, 200, 100]  # leakage of the transmitter stands still
    chirps = np.fft.ifft(spectrum)
    chirps *= 8000 / np.abs(chirps).max()
    cube = np.round(chirps)[:, None, None, None]
    raw = np.frombuffer(as_bytes(cube, true), "<i2")
    assert_advised(one_antenna(raw, 64, 128, read), true, read)


def one_antenna(words, chirps, samples, order):
    size = {"num_chirps": chirps, "num_samples": samples}
    radar = RadarSpec.awr1843(**size, tx_positions=[[0, 0]], rx_positions=[[0, 0]])
    return cube_of_words(words.astype(np.int16).ravel(), radar, order)


def test_no_advice_on_noise_or_silence():
    for seed in range(20):
        noise = np.random.default_rng(seed).integers(-100, 100, (32, 128), np.int16)
        for order in TWO_LANES:
            cube = one_antenna(noise, 32, 64, order)
            assert advise_iq_order(cube, order=order) is None
            assert advise_iq_order(0 * cube, order=order) is None


def test_no_advice_on_a_far_echo_without_leakage():
    """An echo near the end of the range axis is not the leakage of swapped samples."""
    time = np.arange(128)
    noise = np.random.default_rng(0).normal(size=(2, 4, 8, 128, 2)) @ [1, 1j]
    for echo in (60, 100, 118):
        cube = noise + 300 * np.exp(2j * np.pi * echo * time / 128)
        assert advise_iq_order(cube.astype(np.complex64), order="IIQQ") is None


@pytest.mark.parametrize("true", TWO_LANES)
@pytest.mark.parametrize("read", TWO_LANES)
def test_advice_on_simulated_captures(simulated, true, read):
    """The simulation has leakage and noise, but no filter that shapes the noise."""
    cube = simulated.cubes[0]
    words = np.frombuffer(as_bytes(cube[None, :1, :1], true), "<i2")
    assert_advised(one_antenna(words, *cube.shape[2:], read), true, read)


def test_advice_on_another_real_radar(samples):
    cube = np.load(samples / "openradar" / "doppler_example_1.npy")
    parts = (part.astype("u2").view("i2") for part in (cube.real, cube.imag))
    halves = [part.reshape(-1, 64, 2) for part in parts]
    words = {
        "IIQQ": np.concatenate(halves, -1),
        "QQII": np.concatenate(halves[::-1], -1),
        "IQIQ": np.stack(halves, -1),
        "QIQI": np.stack(halves[::-1], -1),
    }
    size = {"num_chirps": 128, "num_samples": 128}
    radar = RadarSpec.awr1843(**size, tx_positions=[[0, 0], [4, 0]])
    for true, order in itertools.product(words, TWO_LANES):
        cube = cube_of_words(words[true].ravel().astype(np.int16), radar, order)
        assert_advised(cube, true, order)
