"""Time offsets are found between samples; unrelated signals are not trusted."""

from pathlib import Path

import numpy as np
import pytest

from jradar.radar import Radar, RadarSpec
from jradar.recordings import propose_offset
from jradar.recordings.recording import Recording, Stream
from jradar.recordings.time_offset import estimate_time_offset, radar_speed

RADAR = RadarSpec.awr1843(
    num_chirps=32,
    num_samples=32,
    frame_period_s=0.08,
    idle_time_s=370e-6,  # one transmitter takes as long as three
    tx_positions=((0, 0),),
    rx_positions=((0, 0),),
)
NOISE = np.random.default_rng(0).normal(size=(2, *RADAR.cube_shape))
C = 299_792_458.0


def motion(times, seed=0):
    """A smooth function of time: walking, stopping, walking."""
    rng = np.random.default_rng(seed)
    size, rate, phase = (
        rng.uniform(*r, (12, 1)) for r in ((0.5, 1), (0.05, 0.8), (0, 6))
    )
    waves = size * np.sin(2 * np.pi * rate * times + phase)
    return np.maximum(waves.sum(0), 0)


@pytest.mark.parametrize("offset", [-3.21, -0.04, 0.0, 0.333, 4.7])
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_known_offset_is_found_between_samples(offset, noise):
    rng = np.random.default_rng(1)
    radar, lidar = 100 + np.arange(0, 30, 0.05), 100 + np.arange(0, 32, 0.1)
    a = 3.0 * motion(radar + offset) + 5
    b = 0.2 * motion(lidar) - 1
    a += noise * a.std() * rng.normal(size=len(a))
    b += noise * b.std() * rng.normal(size=len(b))
    found, confidence = estimate_time_offset(radar, a, lidar, b)
    assert found == pytest.approx(offset, abs=0.01 if noise == 0 else 0.03)
    assert confidence > 0.2


def test_stamps_may_jitter():
    rng = np.random.default_rng(2)
    radar = np.sort(np.arange(0, 30, 0.05) + rng.uniform(0, 0.03, 600))
    lidar = np.sort(np.arange(0, 30, 0.1) + rng.uniform(0, 0.05, 300))
    found, _ = estimate_time_offset(radar, motion(radar + 1.5), lidar, motion(lidar))
    assert found == pytest.approx(1.5, abs=0.02)


def test_unrelated_signals_are_not_trusted():
    times = np.arange(0, 30, 0.1)
    pairs = [(motion(times, 2 * s), motion(times, 2 * s + 1)) for s in range(5)]
    strangers = [estimate_time_offset(times, a, times, b)[1] for a, b in pairs]
    same = [estimate_time_offset(times, a, times, a)[1] for a, _ in pairs]
    assert np.median(strangers) < 0.2 < np.median(same)
    still = np.ones(len(times))
    assert estimate_time_offset(times, still, times, motion(times))[1] == 0


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (np.arange(7.0), "7 radar frames and 7 clouds, expected 8"),
        (np.minimum(np.arange(20.0), 9), "stamps fall or repeat"),
        (np.append(np.arange(20.0), 1e12), "stamps every 1 s span 1e.12 s, expected"),
    ],
)
def test_stamps_of_no_use_are_refused(stamps, message):
    with pytest.raises(ValueError, match=message):
        estimate_time_offset(stamps, stamps, stamps, stamps)


def cube(speed):
    """A wall at 5 m that recedes at `speed`, by the phase of its beat signal."""
    sample = np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    chirp = np.arange(RADAR.num_chirps)[:, None] * RADAR.turn_period_s
    delay = 2 * (5 + speed * chirp) / C
    beat = RADAR.slope_hz_per_s * 2 * 5 / C
    phase = RADAR.center_frequency_hz * delay + beat * sample
    wave = 100 * np.exp(2j * np.pi * phase)
    return (wave + NOISE[0] + 1j * NOISE[1]).astype(np.complex64)


@pytest.mark.parametrize("speed", [0.0, 0.4, -0.7, 1.5])
def test_radar_speed_is_that_of_the_echoes(speed):
    error = 0.7 * RADAR.velocity_resolution_mps
    assert radar_speed(cube(speed), RADAR) == pytest.approx(abs(speed), abs=error)
    assert radar_speed(np.zeros(RADAR.cube_shape, np.complex64), RADAR) == 0


def recording(offset):
    """A rig that rolls towards a wall and back; the radar's stamps lack `offset`."""
    times = np.arange(0, 40, 0.01)
    speed = 0.8 * motion(times)
    way = np.cumsum(speed) * 0.01 * 0.3

    def radar_frame(index):
        return cube(np.interp(radar_stamps[index] + offset, times, speed))

    def cloud(index):
        rng = np.random.default_rng(index)
        angle = rng.uniform(-0.6, 0.6, (2, 4000))
        distance = 30 - np.interp(lidar_stamps[index], times, way)
        y, z = distance * np.tan(angle)
        return np.float32([np.full(4000, distance), y, z, np.ones(4000)]).T

    radar_stamps = 8 + np.arange(180) * 0.1
    lidar_stamps = 4 + np.arange(300) * 0.1
    return Recording(
        name="rig",
        path=Path("rig"),
        radar=Radar(RADAR),
        cubes=Stream(radar_frame, len(radar_stamps), radar_stamps),
        lidar=Stream(cloud, len(lidar_stamps), lidar_stamps),
    )


@pytest.mark.parametrize("offset", [-1.25, 0.6])
def test_offset_of_a_recording(offset):
    found, confidence = propose_offset(recording(offset))
    # A change between two clouds is dated in the middle between them.
    assert found == pytest.approx(offset, abs=0.05)
    assert confidence > 0.1


def test_recordings_that_lack_something_are_refused():
    whole = recording(0.0)
    with pytest.raises(ValueError, match="rig: LiDAR and radar both need stamps"):
        propose_offset(whole._replace(lidar=None))
    few = Stream(whole.cubes.__getitem__, 4, np.arange(4) * 0.1)
    with pytest.raises(ValueError, match="4 radar frames and"):
        propose_offset(whole._replace(cubes=few))
