"""Excision among many strong echoes: a clean frame stays, a jammed one is restored."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    RadarSpec,
    Scatterers,
    crossing_chirps,
    detect,
    draw_interferers,
    excise_interference,
    power_map,
    simulate_cube,
)
from tests.radar.targets import SMALL, simulate, target

RADAR = RadarSpec.awr1843(num_chirps=64)  # 128 samples
POINTS = PointSpec(group_peaks=True, guard=(1, 1), train=(2, 4)).fitted(RADAR)
SURE = dataclasses.replace(POINTS, false_alarm_rate=1e-12)


@functools.partial(jax.jit, static_argnames="points")
def detected(cube, points=POINTS):
    power = power_map(cube)
    return detect(power, RADAR, points=points), jnp.median(power)


def scene(seed, count, least, most, noise_power):
    """An ADC's whole numbers: echoes of `least` to `most` counts, half of them move."""
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-1, 1, count)
    elevation = random.uniform(-0.25, 0.25, count)
    direction = np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        -1,
    )
    reach = 0.95 * RADAR.num_range_bins * RADAR.range_resolution_m
    distance = random.uniform(0.7, reach, (count, 1))
    velocity = random.uniform(-2, 2, count) * (random.random(count) < 0.5)
    amplitude = np.exp(random.uniform(np.log(least), np.log(most), count))
    echoes = Scatterers(
        *(np.float32(values) for values in (distance * direction, velocity, amplitude))
    )
    cube = simulate_cube(jax.random.key(seed), echoes, RADAR, noise_power=noise_power)
    return rounded(cube)


def rounded(cube):
    return jnp.round(cube.real) + 1j * jnp.round(cube.imag)


@pytest.mark.parametrize(
    ("count", "least", "most"), [(60, 20, 300), (20, 20, 3000), (5, 2000, 6000)]
)
@pytest.mark.parametrize("noise_power", [1.0, 10.0])
@pytest.mark.parametrize("seed", range(2))
def test_a_clean_frame_of_many_echoes_is_returned(
    count, least, most, noise_power, seed
):
    cube = scene(seed, count, least, most, noise_power)
    excised, found = excise_interference(cube)
    assert not found.any()
    np.testing.assert_array_equal(excised, cube)


@pytest.mark.parametrize(
    ("count", "least", "most", "jammed"),
    [(60, 20, 300, 100.0), (20, 20, 3000, 300.0), (20, 3, 30, 300.0)],
)
def test_detections_of_a_jammed_frame_come_back(count, least, most, jammed):
    """At the floor of the clean frame, of which crossing chirps hide a part."""
    sure = kept = hidden = 0
    for seed in range(4):
        clean = scene(seed, count, least, most, 10.0)
        others = draw_interferers(
            jax.random.key(seed), RADAR, count=3, amplitude=jammed
        )
        samples = crossing_chirps(jax.random.key(seed), others, RADAR)
        disturbed = rounded(clean + samples)
        excised, _ = excise_interference(disturbed)
        (wanted, _), (_, floor) = detected(clean, SURE), detected(clean)
        (found, after), (lost, before) = detected(excised), detected(disturbed)
        sure += int(wanted.sum())
        kept += int((wanted & near(found)).sum())
        hidden += int((wanted & ~near(lost)).sum())
        assert after < 1.2 * floor < before / 2
    assert kept >= 0.97 * sure and sure - kept <= hidden / 5


def near(mask):
    """The cells of a mask and their neighbours."""
    for axis in (0, 1):
        mask = mask | np.roll(mask, 1, axis) | np.roll(mask, -1, axis)
    return mask


@pytest.mark.parametrize("amplitude", [1.0, 1000.0])
def test_a_frame_without_noise_is_returned(amplitude):
    """What is left of its echo is float32's rounding, tiny but not alike everywhere."""
    for seed in range(4):
        echo = target(3.2 + 0.03 * seed, 10, 5, 0.37 * seed, amplitude=amplitude)
        cube = simulate_cube(jax.random.key(seed), echo, SMALL)
        excised, found = excise_interference(cube)
        assert not found.any()
        np.testing.assert_array_equal(excised, cube)


def test_a_burst_far_below_a_strong_echo_is_found():
    """56 dB below it, and 14 dB over the noise."""
    cube = simulate(target(3, 10, 0, 0.0, amplitude=3000.0))
    cube = cube.at[1, :, 16, 30:34].add(5.0)
    _, found = excise_interference(cube)
    assert found[1, 16, 30:34].all() and not found.at[1, 16].set(False).any()
