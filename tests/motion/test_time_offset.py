"""Time offsets are found between samples; unrelated signals are not trusted."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.lidar import Poses
from jradar.motion import propose_offset
from jradar.motion.time_offset import estimate_time_offset
from jradar.radar import Radar, RadarSpec, Scatterers, simulate_cube
from jradar.recordings import Recording, Stream

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)


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
    found, confidence = estimate_time_offset(radar, a[:, None], lidar, b[:, None])
    assert found == pytest.approx(offset, abs=0.01 if noise == 0 else 0.03)
    assert confidence > 0.2


def test_stamps_may_jitter():
    rng = np.random.default_rng(2)
    radar = np.sort(np.arange(0, 30, 0.05) + rng.uniform(0, 0.03, 600))
    lidar = np.sort(np.arange(0, 30, 0.1) + rng.uniform(0, 0.05, 300))
    true, seen = motion(radar + 1.5)[:, None], motion(lidar)[:, None]
    found, _ = estimate_time_offset(radar, true, lidar, seen)
    assert found == pytest.approx(1.5, abs=0.02)


def test_unrelated_signals_are_not_trusted():
    times = np.arange(0, 30, 0.1)

    def confidence(a, b):
        return estimate_time_offset(times, a[:, None], times, b[:, None])[1]

    pairs = [(motion(times, 2 * s), motion(times, 2 * s + 1)) for s in range(5)]
    unrelated = [confidence(a, b) for a, b in pairs]
    same = [confidence(a, a) for a, _ in pairs]
    assert np.median(unrelated) < 0.2 < np.median(same)
    assert confidence(np.ones(len(times)), motion(times)) == 0


def test_all_components_speak_for_an_offset():
    """Either alone has its best offset elsewhere, where it is disturbed."""
    times = np.arange(0, 30, 0.1)
    late = times + 0.7
    both = np.stack([motion(times, 1), motion(times, 2)], -1)
    seen = np.stack([motion(late, 1), motion(late, 2)], -1)
    found, confidence = estimate_time_offset(times, seen, times, both)
    assert found == pytest.approx(0.7, abs=0.02)
    for part in (0, 1):
        one = [signal[:, part : part + 1] for signal in (seen, both)]
        assert confidence > estimate_time_offset(times, one[0], times, one[1])[1]


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (np.arange(7.0), "7 measurements of the radar's motion and 7 of the LiDAR's"),
        (np.minimum(np.arange(20.0), 9), "stamps fall or repeat"),
        (np.append(np.arange(20.0), 1e12), "stamps every 1 s span 1e.12 s, expected"),
    ],
)
def test_stamps_of_no_use_are_refused(stamps, message):
    with pytest.raises(ValueError, match=message):
        estimate_time_offset(stamps, stamps[:, None], stamps, stamps[:, None])


def recording(offset, *, with_poses):
    """A rig that rolls towards a wall, past posts; the radar's stamps lack `offset`.

    With poses it also sways, which its distance from the wall does not show.
    """
    rng = np.random.default_rng(0)
    times = np.arange(0, 40, 0.01)
    forward = 0.3 * motion(times)
    aside = 0.2 * with_poses * (motion(times, 1) - 1)
    way = np.stack([np.cumsum(forward), np.cumsum(aside), 0 * times], -1) * 0.01
    distance, angle = rng.uniform(2, 10, 40), rng.uniform(-0.9, 0.9, 40)
    direction = np.stack([np.cos(angle), np.sin(angle), 0 * angle], -1)
    posts = distance[:, None] * direction
    radar_stamps = 8 + np.arange(180) * 0.1
    lidar_stamps = 4 + np.arange(300) * 0.1

    def radar_frame(index):
        then = radar_stamps[index] + offset + RADAR.frame_middle_s
        velocity = [np.interp(then, times, part) for part in (forward, aside)]
        echoes = Scatterers(
            jnp.asarray(posts, jnp.float32),
            jnp.asarray(-direction[:, :2] @ velocity, jnp.float32),
            jnp.full(len(posts), 50.0, jnp.float32),
        )
        return simulate_cube(jax.random.key(index), echoes, RADAR, noise_power=100.0)

    def cloud(index):
        angle = np.random.default_rng(index).uniform(-0.6, 0.6, (2, 4000))
        ahead = 60 - np.interp(lidar_stamps[index], times, way[:, 0])
        y, z = ahead * np.tan(angle)
        return np.float32([np.full(4000, ahead), y, z, np.ones(4000)]).T

    stamps = times[::10]
    poses = Poses(stamps, way[::10], np.tile([0.0, 0, 0, 1], (len(stamps), 1)))
    return Recording(
        name="rig",
        path=Path("rig"),
        radar=Radar(RADAR),
        cubes=Stream(radar_frame, len(radar_stamps), radar_stamps),
        lidar=Stream(cloud, len(lidar_stamps), lidar_stamps),
        poses=poses if with_poses else None,
    )


@pytest.mark.parametrize("with_poses", [True, False])
@pytest.mark.parametrize("offset", [-1.25, 0.6])
def test_offset_of_a_recording(offset, with_poses):
    found = propose_offset(recording(offset, with_poses=with_poses))
    assert found.compared_with == ("poses" if with_poses else "clouds")
    assert found.seconds == pytest.approx(offset, abs=0.01 if with_poses else 0.05)
    assert found.confidence > 0.1


def test_recordings_that_lack_something_are_refused():
    whole = recording(0.0, with_poses=False)
    with pytest.raises(ValueError, match="rig: expected times of the radar's frames"):
        propose_offset(whole._replace(lidar=None))
    cubes, clouds = whole.cubes, whole.lidar
    few = Stream(cubes.__getitem__, 4, cubes.stamps[:4])
    with pytest.raises(ValueError, match="4 measurements of the radar's motion"):
        propose_offset(whole._replace(cubes=few))
    later = Stream(clouds.__getitem__, len(clouds), clouds.stamps + 1000)
    with pytest.raises(ValueError, match="0 clouds within 5 s of the radar's frames"):
        propose_offset(whole._replace(lidar=later))
    other = recording(0.0, with_poses=True)
    early = other.poses._replace(stamps=other.poses.stamps - 1000)
    with pytest.raises(ValueError, match="0 poses within 5 s of the radar's frames"):
        propose_offset(other._replace(poses=early))
