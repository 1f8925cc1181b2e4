"""Doubts about samples: clipped, in another byte order or code; no false alarms."""

import dataclasses

import jax
import numpy as np
import pytest

from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.recordings import check_samples, open_recording, with_sample_warnings
from tests.recordings.cube_writer import SHAPE, random_cube, save

AS_STORED = {  # how a file would have to store samples for them to be read wrongly
    "the other byte order": lambda words: words.byteswap(),
    "offset binary": lambda words: words ^ np.int16(-(2**15)),
    "offset binary and the other": lambda w: (w ^ np.int16(-(2**15))).byteswap(),
}


def frame(level=300.0, noise=3.0, chirps=16, samples=64, seed=0, channels=(2, 4)):
    """Three echoes in noise, as counts of a converter."""
    rng = np.random.default_rng(seed)
    time, cube = np.arange(samples), 0
    shape = (*channels, chirps, 1)
    for k, (part, echo) in enumerate([(1.0, 2), (0.5, 9.3), (0.2, 17.7)]):
        phase = rng.uniform(0, 2 * np.pi, shape) + k
        cube = cube + part * level * np.exp(1j * (2 * np.pi * echo * time / 64 + phase))
    cube = cube + noise * (rng.normal(size=(*cube.shape, 2)) @ [1, 1j])
    return np.rint(cube.real) + 1j * np.rint(cube.imag)


def of_words(words):
    return (words[0].astype(np.float32) + 1j * words[1]).astype(np.complex64)


def words_of(cube):
    return np.stack([cube.real, cube.imag]).astype(np.int16)


def clipped(cube, scale, gain=1.0, step=1):
    """The cube as a converter stores it if its peak is `gain` times full scale."""
    peak = max(abs(cube.real).max(), abs(cube.imag).max())
    parts = np.rint(np.stack([cube.real, cube.imag]) * gain * scale / step / peak)
    return of_words(np.clip(parts, -scale // step, scale // step - 1) * step)


@pytest.fixture(params=["openradar", "dca1000", "awr1843_3tx", "simulated", "drawn"])
def cube(request):
    """Frames of real radars, of a simulated one, and echoes in noise."""
    if request.param == "simulated":
        return request.getfixturevalue("simulated").cubes[0]
    if request.param == "drawn":
        return frame().astype(np.complex64)
    folder = request.getfixturevalue("samples") / request.param
    if request.param == "openradar":
        stored = np.load(folder / "doppler_example_1.npy").transpose(1, 0, 2)[None]
        return of_words(np.stack([stored.real, stored.imag]).astype("u2").view("i2"))
    if request.param == "dca1000":
        return open_recording(folder / "adc_data_0.bin").cubes[0]
    words = np.fromfile(folder / "adc_data_Raw_0.bin", "<i2")
    words = words.reshape(64, 3, 4, 128, 2, 2).transpose(4, 1, 2, 0, 3, 5)
    return of_words(words.reshape(2, 3, 4, 64, 256))


def test_good_samples_raise_no_warning(cube):
    found = check_samples(cube)
    assert found.warnings == () and found.full_scale is None and found.share == 0
    assert found.largest == np.abs(words_of(cube).astype(int)).max()


@pytest.mark.parametrize("name", AS_STORED)
def test_samples_in_another_code_are_named(cube, name):
    stored = of_words(AS_STORED[name](words_of(cube)))
    [warning] = check_samples(stored).warnings
    assert f"look like numbers in {name}" in warning and "dB lower" in warning


@pytest.mark.parametrize("middle", [2**11, 2**13, 2**15])
def test_unsigned_samples_are_named(cube, middle):
    parts = words_of(cube).astype(float)
    parts = np.rint(parts * min(1, (middle - 1) / np.abs(parts).max())) + middle
    [warning] = check_samples(of_words(parts)).warnings
    assert f"swing about {middle:,}" in warning and f"subtract {middle:,}" in warning


@pytest.mark.parametrize(
    ("scale", "step"),
    [(2**15, 1), (2**13, 1), (2**11, 1), (2**15, 16)],  # the last: 12 bits, shifted
)
def test_clipping_is_measured(cube, scale, step):
    found = check_samples(clipped(cube, scale, gain=3.0, step=step))
    assert found.full_scale == scale and 0.02 < found.share < 0.6
    [warning] = found.warnings
    assert f"{found.share:.1%} of the samples are at full scale" in warning
    parts = words_of(clipped(frame(), 2**15, gain=2.0))  # now with equal ends
    assert check_samples(of_words(np.maximum(parts, 1 - 2**15))).share > 0.1


def test_peaks_and_a_tone_near_full_scale_are_no_clipping(cube):
    """A tone visits its extremes more often than other values."""
    phase = np.linspace(0, 200 * np.pi, 2 * 4 * 8 * 256).reshape(2, 4, 8, 256)
    for scale in (2**15, 2**13, 2**11):
        assert check_samples(clipped(cube, scale, gain=0.999)).warnings == ()
        tone = np.rint((scale - 1) * np.stack([np.cos(phase), np.sin(phase)]))
        assert check_samples(of_words(tone)).warnings == ()


def test_scaled_and_real_samples_and_noise_raise_no_warning():
    for factor in (1 / 7, 1e6, 1e20):
        assert check_samples((frame() * factor).astype(np.complex64)).warnings == ()
    assert check_samples(random_cube((3, 4, 16, 64))).warnings == ()
    noise = np.random.default_rng(0).integers(-(2**15), 2**15, (2, 2, 4, 16, 64))
    assert check_samples(of_words(noise.astype(np.int16))).warnings == ()
    real = frame(channels=(1, 2)).real.astype(np.float32)
    assert check_samples(real).warnings == ()
    swapped = real.astype(np.int16).byteswap().astype(np.float32)
    assert "the other byte order" in check_samples(swapped).warnings[0]


def test_warnings_are_notes_of_a_recording(tmp_path):
    recording = open_recording(save(tmp_path, random_cube()))
    assert with_sample_warnings(recording, 0).notes == ()
    silent = open_recording(save(tmp_path, np.zeros(SHAPE, np.complex64)))
    [note] = with_sample_warnings(silent, 0).notes
    assert note.startswith("frame 0: all samples are zero: did the radar send")


def split(cube, count):
    """The same chirps, taken for those of another number of antennas."""
    in_time = np.moveaxis(cube, 2, 0).reshape(-1, *cube.shape[1::2])
    parts = in_time.reshape(-1, count, *in_time.shape[1:])
    return np.moveaxis(np.moveaxis(parts, 1, 0), 1, 2)


@pytest.mark.parametrize("speed", [0.0, 0.4, 3.0])
@pytest.mark.parametrize(("sent", "taken"), [(3, 2), (2, 3), (2, 1), (3, 1)])
def test_chirps_of_another_number_of_antennas_are_named(sent, taken, speed):
    full = RadarSpec.awr1843(num_chirps=48, num_samples=64)
    fewer = {"tx_firing_order": tuple(range(sent))}
    radar = dataclasses.replace(full, tx_positions=full.tx_positions[:sent], **fewer)
    key = jax.random.key(0)
    place = jax.random.uniform(key, (12, 3), minval=-3.0, maxval=3.0)
    place = place + np.array([6.0, 0, 0])
    targets = Scatterers(place, np.full(12, speed), np.full(12, 3e3))
    cube = np.rint(np.asarray(simulate_cube(key, targets, radar, noise_power=1.0)))
    assert check_samples(cube).warnings == ()
    (warning,) = check_samples(split(cube, taken)).warnings
    assert f"repeat after {sent}, not after {taken}" in warning


def test_halves_of_chirps_are_no_chirps(samples):
    """A real capture of 3 transmitters, read with half its samples."""
    words = np.fromfile(samples / "awr1843_3tx" / "adc_data_Raw_0.bin", "<i2")
    words = words.reshape(128, 3, 4, 64, 2, 2).transpose(4, 1, 2, 0, 3, 5)
    cube = of_words(words.reshape(2, 3, 4, 128, 128))
    for first in range(0, 128, 16):
        (warning,) = check_samples(cube[:, :, first : first + 16]).warnings
        assert "repeat after 6, not after 3" in warning
        assert "with 256 samples per chirp instead of 128" in warning


def test_a_real_echo_ahead_of_two_antennas_instead_of_three(samples):
    words = np.fromfile(samples / "awr1843_3tx" / "adc_data_Raw_0.bin", "<i2")
    words = words.reshape(96, 2, 4, 128, 2, 2).transpose(4, 1, 2, 0, 3, 5)
    (warning,) = check_samples(of_words(words.reshape(2, 2, 4, 96, 256))).warnings
    assert "repeat after 3, not after 2" in warning


@pytest.mark.parametrize("sent", [2, 3])
def test_halves_of_simulated_chirps(sent):
    full = RadarSpec.awr1843(num_chirps=48, num_samples=128)
    fewer = {"tx_firing_order": tuple(range(sent))}
    radar = dataclasses.replace(full, tx_positions=full.tx_positions[:sent], **fewer)
    key = jax.random.key(0)
    place = jax.random.uniform(key, (12, 3), minval=-3.0, maxval=3.0)
    targets = Scatterers(place + np.array([6.0, 0, 0]), np.zeros(12), np.full(12, 3e3))
    cube = np.rint(np.asarray(simulate_cube(key, targets, radar, noise_power=1.0)))
    halves = np.moveaxis(cube, 2, 0).reshape(96, sent, 4, 64)
    (warning,) = check_samples(np.moveaxis(halves, 0, 2)).warnings
    assert f"repeat after {2 * sent}, not after {sent}" in warning
