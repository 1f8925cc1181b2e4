"""Frames of another number of chirps than described: noticed by pauses, else quiet."""

from pathlib import Path

import numpy as np
import pytest

from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream, with_sample_warnings
from jradar.recordings.frame_checks import frame_warnings
from tests.recordings.ti.test_lanes import captures, chirps_of

SENT, PAUSE = 32, 400  # chirps of a frame, and the time of so many until the next


def walk(frames=16, *, speeds=(0.02, -0.05, 0.011), noise=0.3, pause=PAUSE, seed=0):
    """[chirp, tx, rx, sample] of a wall, and of targets that move."""
    rng = np.random.default_rng(seed)
    chirp = np.arange(SENT * frames)
    time = chirp + pause * (chirp // SENT)
    cube = 0.0
    for k, speed in enumerate((0.0, *speeds)):
        phase = speed * time[:, None, None, None] + rng.uniform(0, 6, (1, 3, 4, 1))
        tone = 2 * np.pi * (5.3 + 6.1 * k) / 64 * np.arange(64)
        cube = cube + (300.0 if k == 0 else 40.0) * np.exp(1j * (phase + tone))
    cube = cube + noise * (rng.normal(size=(*cube.shape, 2)) @ [1, 1j])
    return np.rint(cube.real) + 1j * np.rint(cube.imag)


def recorded(chirps, described):
    """The recording of chirps, described with so many in a frame."""
    size = {"num_chirps": described, "num_samples": chirps.shape[-1]}
    radar = Radar(RadarSpec.awr1843(**size, ramp_end_time_s=1e-4))
    count = len(chirps) // described
    cut = chirps[: count * described].reshape(count, described, *chirps.shape[1:])
    return Recording(
        "x", Path("x"), radar, Stream(lambda k: np.moveaxis(cut[k], 0, 2), count)
    )


@pytest.mark.parametrize("described", [8, 16, 24, 30, 64, 96, 128])
@pytest.mark.parametrize("seed", range(3))
def test_another_number_of_chirps_is_named(described, seed):
    recording = recorded(walk(seed=seed), described)
    for frame in (0, len(recording.cubes) - 1):
        (warning,) = frame_warnings(recording, frame)
        assert "jump after every 32 chirps of a transmitter, as from frame" in warning
        assert f"not after {described} as described" in warning
        assert "with 32 chirps per frame" in warning


@pytest.mark.parametrize("seed", range(5))
def test_frames_as_described_or_without_motion_or_pauses_are_not(seed):
    assert not [*frame_warnings(recorded(walk(seed=seed), SENT), 0)]
    for described in (16, 64):
        still = recorded(walk(speeds=(0.0,), seed=seed), described)
        steady = recorded(walk(pause=0, seed=seed), described)
        assert not [*frame_warnings(still, 0)] and not [*frame_warnings(steady, 0)]
    noise = np.random.default_rng(seed).normal(size=(256, 3, 4, 64, 2)) @ [1, 1j]
    assert not [*frame_warnings(recorded(noise, 16), 0)]
    assert not [*frame_warnings(recorded(0 * noise, 16), 0)]


def test_the_warning_is_a_note_and_only_of_its_own_frame():
    recording = recorded(walk(), 64)
    (note,) = with_sample_warnings(recording, 1).notes
    assert note.startswith("frame 1: the echoes jump after every 32")

    def damaged(index):
        if index > 2:
            raise ValueError("damaged")
        return recording.cubes[index]

    broken = recording._replace(cubes=Stream(damaged, len(recording.cubes)))
    assert with_sample_warnings(broken, 0).notes  # of three frames
    assert not with_sample_warnings(recorded(walk(), 2), 0).notes  # too few to say


def test_real_captures(samples):
    """Those of one frame, or of one chirp a frame, say nothing, however described."""
    for path, (tx, rx, size) in captures(samples).items():
        if not path.is_file():
            continue
        chirps = chirps_of(np.fromfile(path, "<i2", 4_000_000), tx, rx, size)
        for described in (16, 32, 64, 128, 192, 256):
            recording = recorded(chirps, described)
            if "gao" not in str(path) or described == 128:
                if len(recording.cubes):
                    assert not [*frame_warnings(recording, 0)], (path, described)
            elif described > 16:
                (warning,) = frame_warnings(recording, 0)
                assert "jump after every 128 chirps" in warning
