"""Gradients of radar points with respect to the cube: finite whatever was received."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import DETECTORS, PointSpec, Radar, RadarSpec, radar_points
from jradar.radar.detect.cfar_window import EDGES
from jradar.radar.point_spec import ANGLES

RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=16)
WINDOW = {"guard": (1, 1), "train": (1, 2), "capacity": 24, "false_alarm_rate": 0.5}
OPTIONS = (
    *({}, {"refine": False, "edge": "fill", "train": (0, 4)}),
    {"detector": "ca", "edge": "reflect", "factor": 0.5},
    {"remove_static": True, "remove_interference": True, "edge": "wrap"},
    {"group_peaks": True, "detector": "so", "edge": "one_sided"},
    {"detector": "go", "edge": "skip", "num_azimuth": 32, "num_elevation": 8}
    | {"range_window": "none", "doppler_window": "blackman"},
    {"focus": True, "range_window": "hamming", "doppler_window": "none"},
    *({"folds": 1}, {"folds": 1, "peaks": 2}, {"peaks": 2}),
    *({"angles": angles} for angles in ("capon", "music")),
    *({"angles": angles, "peaks": 2} for angles in ("capon", "music")),
    {"angles": "music", "sources": 0, "peaks": 3, "folds": 1},
)


def frames():
    """Silent, one sample, every sample at full scale, and noise: as real parts."""
    shape = (2, *RADAR.cube_shape)
    one = np.zeros(shape, np.float32)
    one[0, 0, 0, 3, 5] = 1.0
    full = np.full(shape, 2.0**15, np.float32)
    noise = np.random.default_rng(0).normal(size=shape).astype("float32")
    return np.stack([0 * one, one, full, noise])


def test_every_option_and_every_choice_has_a_gradient_here():
    tried = [dataclasses.asdict(PointSpec(**(WINDOW | one))) for one in OPTIONS]
    for field, usual in dataclasses.asdict(PointSpec()).items():
        choices = {"detector": DETECTORS, "edge": EDGES, "angles": ANGLES}.get(field)
        found = {options[field] for options in tried}
        assert found >= {*choices} if choices else found - {usual}, field


CASES = [(options, False) for options in OPTIONS] + [({"folds": 1}, True)]


@pytest.mark.parametrize(("options", "leaky"), CASES, ids=str)
def test_gradients_are_finite_whatever_was_received(options, leaky):
    leakage = jnp.full((3, 4, 8), 5 + 2j, jnp.complex64) if leaky else None
    radar = Radar(RADAR, leakage=leakage)
    points = PointSpec(**(WINDOW | options))

    @jax.jit
    @jax.grad
    def gradient(parts):
        cloud = radar_points(jax.lax.complex(*parts), radar, points=points)
        numbers = (part for part in cloud if part is not None)
        return sum(part.sum() for part in numbers if part.dtype == jnp.float32)

    silent, *others = (np.asarray(gradient(tuple(parts))) for parts in frames())
    assert not silent.any()
    for found in others:
        assert np.isfinite(found).all()
    assert others[-1].any()


def test_a_frame_that_was_not_received_has_no_points_of_its_leakage():
    leaky = Radar(RADAR, leakage=jnp.full((3, 4, 8), 5 + 2j, jnp.complex64))
    points = PointSpec(**(WINDOW | {"false_alarm_rate": 1.0}))
    for level, expected in ((0.0, False), (1.0, True)):
        cube = jnp.full(RADAR.cube_shape, level, jnp.complex64)
        assert radar_points(cube, leaky, points=points).valid.any() == expected
