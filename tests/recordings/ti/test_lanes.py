"""Samples that were lost on two of four lanes: noticed, restored, no false alarms."""

import dataclasses

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.radar import RadarSpec
from jradar.recordings import open_recorder, open_recording
from jradar.recordings.ti import lanes
from tests.recordings.dca1000_writer import as_bytes
from tests.recordings.lua_writer import COM405, FOUR_LANES, TWO_LANES, script

RADAR = RadarSpec.awr1843(num_samples=128, num_chirps=4)
TONE = 2 * np.pi / 128
ADVICE, RESTORED = "half of the samples are missing: after", "four LVDS lanes were"


def halves(cube):
    """Samples 0, 1, 4, 5, .. of each chirp."""
    return cube.reshape(*cube.shape[:-1], -1, 4)[..., :2].reshape(*cube.shape[:-1], -1)


def echoes(seed=0, far=0.3, count=6, level=600.0):
    """Whole numbers of a converter: echoes at random, and noise 50 dB below them.

    `far` is the range of the farthest, of the range axis.
    """
    rng = np.random.default_rng(seed)
    place = rng.uniform(3, far * 128, count)
    strength = level * 10 ** rng.normal(0, 0.3, count) * np.minimum(8 / place, 1)
    phase = np.pi * rng.uniform(-1, 1, (count, 1)) * np.arange(12)  # by antenna
    phase = phase + rng.uniform(0, 2 * np.pi, (count, 1))
    tones = np.exp(1j * TONE * place[:, None] * np.arange(128))
    chirp = np.einsum("k,ka,kt->at", strength, np.exp(1j * phase), tones)
    noise = rng.normal(size=(12, 4, 128, 2)) @ [1, 1j]
    cube = chirp[:, None] + level / 300 * noise
    return np.rint(cube).reshape(3, 4, 4, 128)


def test_missing_samples_are_noticed_and_only_those():
    """No false alarm; a few scenes of many echoes stay unclear."""
    found = []
    for seed in range(60):
        for far in (0.3, 0.45, 0.9):
            cube = echoes(seed, far)
            assert lanes.samples_missing(cube) is not True
            found.append(lanes.samples_missing(halves(cube)))
    assert found.count(True) > 0.8 * len(found) and found.count(False) < 3


def test_what_shows_nothing_is_unclear():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(3, 4, 16, 128, 2)) @ [1, 1j]
    assert lanes.samples_missing(noise) is None
    assert lanes.samples_missing(np.zeros((3, 4, 1, 64), complex)) is None
    assert lanes.samples_missing(echoes().real) is None
    assert lanes.samples_missing(halves(echoes())[:, :1, :1]) is None  # one chirp
    near = np.exp(1j * TONE * 2 * np.arange(128)) + 0.01 * noise
    assert lanes.samples_missing(halves(near)) is None


@pytest.mark.parametrize("place", [0.3, 3.0, 17.4, 31.5, 32.0, 40.2, 58.9])
def test_an_echo_is_restored_without_its_ghost(place):
    chirp = np.exp(1j * TONE * place * np.arange(128))
    cube = np.broadcast_to(chirp, (1, 1, 1, 128))
    found = lanes.restored(halves(cube))[0, 0, 0]
    np.testing.assert_allclose(found[::2], chirp[::4], rtol=1e-6)
    power = np.abs(np.fft.fft(found * np.hanning(64))) ** 2
    assert abs(power.argmax() - place) <= 0.6
    elsewhere = np.abs((np.arange(64) - place + 32) % 64 - 32) > 4
    assert power[elsewhere].max() < 10**-4 * power.max()


def test_the_radar_of_what_is_left():
    left = lanes.halved(RADAR)
    assert left.num_samples == 64 and left.max_range_m == RADAR.max_range_m / 2
    assert left.range_resolution_m == pytest.approx(RADAR.range_resolution_m)
    assert left.wavelength_m == RADAR.wavelength_m
    assert not lanes.may_be_halved(RADAR, 4, "I4Q4")  # of a board with four lanes
    assert not lanes.may_be_halved(RADAR, 2, "IIQQ")
    odd = dataclasses.replace(RADAR, num_samples=126)
    assert not lanes.may_be_halved(odd, 4, "IIQQ")


@pytest.fixture
def capture(tmp_path):
    """A function that writes frames with a description: a recording."""

    def capture(cubes, description, name):
        (tmp_path / "adc_data.bin").write_bytes(as_bytes(cubes))
        (tmp_path / name).write_text(description)
        return open_recording(tmp_path / "adc_data.bin")

    return capture


TOML = """[radar]
device = "awr1843"
num_samples = 128
num_chirps = 4
"""


def test_a_described_loss_is_read_right(capture):
    whole = echoes()
    recording = capture([halves(whole)] * 2, TOML + "[file]\nlanes = 4\n", "radar.toml")
    assert recording.radar.spec == lanes.halved(
        dataclasses.replace(RADAR, name=recording.radar.spec.name)
    )
    assert len(recording.cubes) == 2
    [note] = recording.notes
    assert (
        note.startswith(RESTORED)
        and f"beyond {0.475 * RADAR.max_range_m:.3g} m" in note
    )
    cube = recording.cubes[1]
    np.testing.assert_array_equal(cube[..., ::2], whole[..., ::4])
    error = cube[..., 10:-10] - whole[..., ::2][..., 10:-10]
    assert np.abs(error).max() < 0.05 * np.abs(whole).max()


def test_an_unknown_loss_is_noticed(capture):
    """Half the bytes: chirps of 64 samples, or half as many frames of 128."""
    stored = [halves(echoes())] * 2
    for samples in (64, 128):
        text = TOML.replace("128", str(samples))
        [note] = capture(stored, text, "radar.toml").notes
        assert note.startswith(ADVICE) and "lanes = 4 in [file]" in note
    assert capture([echoes()] * 2, TOML, "radar.toml").notes == ()


def with_turns(text, frames):
    return text.replace("(0, 2, 1000, 1,", f"(0, 2, {frames}, 4,")


def test_a_script_of_four_lanes(capture):
    """The samples decide, and where they cannot, the number of bytes."""
    whole, quiet = echoes(), np.zeros((3, 4, 4, 128))
    text = with_turns(script(COM405), 2)
    lost = capture([halves(whole)] * 2, text, "a.lua")
    assert lost.notes[0].startswith(RESTORED) and len(lost.cubes) == 2
    kept = capture([whole] * 2, text, "a.lua")
    assert kept.notes == (lanes.NONE_MISSING,)
    np.testing.assert_array_equal(kept.cubes[1], whole)
    assert capture([quiet] * 2, text, "a.lua").notes == (lanes.NONE_MISSING,)
    assert len(capture([halves(quiet)] * 2, text, "a.lua").cubes) == 2
    two = text.replace(FOUR_LANES, TWO_LANES)
    assert capture([whole] * 2, two, "a.lua").notes == ()


def test_samples_of_other_files_are_not_restored(capture, tmp_path):
    """A cube and a bag refuse a description of lost samples in one line."""
    pytest.importorskip("rosbags")
    radar = capture([echoes()], TOML, "plain.toml")
    with open_recorder(tmp_path / "walk.mcap", radar) as recorder:
        recorder.write(np.frombuffer(as_bytes([echoes()]), np.uint8), 1.0)
    np.save(tmp_path / "cube.npy", echoes().astype(np.complex64))
    (tmp_path / "radar.toml").write_text(TOML + "[file]\nlanes = 4\n")
    with pytest.raises(UsageError, match="cube.npy: its description enables 4 LVDS"):
        open_recording(tmp_path / "cube.npy", tmp_path / "radar.toml")
    with pytest.raises(UsageError, match=r"walk.mcap: .* without lanes if none are"):
        open_recording(tmp_path / "walk.mcap", tmp_path / "radar.toml")


def captures(samples):
    """Each raw capture among the samples with its transmitters, receivers, samples."""
    return {
        **{
            samples / "com304" / f"{name}_Raw_0.bin": (3, 4, 512)
            for name in ("1", "2", "record1")
        },
        samples / "awr1843_3tx" / "adc_data_Raw_0.bin": (3, 4, 256),
        samples / "gao_awr1642" / "adc_data.bin": (2, 4, 128),
        samples / "dca1000" / "adc_data_0.bin": (1, 4, 256),
    }


def chirps_of(words, tx, rx, size):
    """[chirp, tx, rx, sample] of int16 in the order I0 I1 Q0 Q1."""
    words = words[: len(words) // (4 * tx * rx * size // 2) * (2 * tx * rx * size)]
    parts = words.reshape(-1, tx, rx, size // 2, 2, 2).astype(float)
    return (parts[..., 0, :] + 1j * parts[..., 1, :]).reshape(-1, tx, rx, size)


def test_no_real_capture_causes_a_false_alarm(samples):
    found = 0
    for path, (tx, rx, size) in captures(samples).items():
        if not path.is_file():
            continue
        words = np.fromfile(path, "<i2", 2_000_000)
        for taken in (size, size // 2):  # also with a description of half the size
            chirps = chirps_of(words, tx, rx, taken)
            for at in range(0, min(len(chirps), 200), 20):
                cube = np.moveaxis(chirps[at : at + 2], 0, 2)
                assert lanes.samples_missing(cube) is not True, (path, at)
                found += 1
    stored = np.load(samples / "openradar" / "doppler_example_1.npy")
    parts = np.stack([stored.real, stored.imag]).astype("u2").view("i2").astype(float)
    cube = (parts[0] + 1j * parts[1]).reshape(128, 2, 4, 128).transpose(1, 2, 0, 3)
    assert lanes.samples_missing(cube) is False
    content = (samples / "ti_mmwavelib" / "radarDemo_captured_test.bin").read_bytes()
    words = np.frombuffer(content, "<i2", 4 * 40_960, 320).reshape(4, -1)
    words = words[:, : 32 * 1024].reshape(4, 32, 1024)
    pairs = words[..., :512].reshape(1, 4, 32, 256, 2).astype(float)
    assert lanes.samples_missing(pairs[..., 0] + 1j * pairs[..., 1]) is False
    assert found > 50


def test_the_real_capture_that_lost_half_its_samples(samples, tmp_path):
    path = samples / "com405" / "task3_gt_Raw_0.bin"
    if not path.is_file():
        pytest.skip("no com405 among the samples")
    (tmp_path / "b.lua").write_text(script(COM405))
    recording = open_recording(path, description=tmp_path / "b.lua")
    assert len(recording.cubes) == 1000 and recording.notes[0].startswith(RESTORED)
    cube = np.stack(recording.cubes[:50])
    spectrum = np.fft.fft((cube - cube.mean(-1, keepdims=True)) * np.hanning(64))
    power = (np.abs(spectrum) ** 2).mean((0, 1, 2, 3))
    strongest = int(power[4:].argmax()) + 4
    metres = strongest * recording.radar.spec.range_resolution_m
    assert metres == pytest.approx(0.86, abs=0.01)
    assert 10 * np.log10(power[strongest + 32] / power[strongest]) < -35
    (tmp_path / "c.lua").write_text(script(COM405, lanes=TWO_LANES))
    unaware = open_recording(path, description=tmp_path / "c.lua")
    assert unaware.notes[0].startswith(ADVICE) and len(unaware.cubes) == 500
