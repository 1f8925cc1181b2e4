"""Under `vmap` and with leading axes as in a loop; gradients of points are finite."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.options.detectors import EDGES
from jradar.options.points import ANGLES
from jradar.radar import (
    DETECTORS,
    PointSpec,
    Radar,
    RadarSpec,
    all_cells,
    calibrate,
    cell_points,
    excise_interference,
    radar_points,
    range_doppler,
    subtract_leakage,
)
from jradar.radar.angle.subspace import capon_spectrum, music_spectrum
from jradar.radar.clean.interference import crossing_chirps, draw_interferers
from tests.radar.targets import (
    CELLS,
    FLAT,
    SMALL,
    close,
    noise,
    simulate,
    single,
    target,
)

CUBES = jnp.stack([simulate(target(3 + i, 10 * i, 5, 1), seed=i) for i in range(3)])
POWER = np.random.default_rng(0).exponential(size=(3, 32, 64)).astype("float32")
SNAPSHOTS = single(noise(3, 6, 8))
UNIT = Radar(SMALL, channels=noise(3, 4), beat_bins=np.linspace(0, 1, 12).reshape(3, 4))
LEAKAGE = single(noise(3, 4, 32))


def disturbed():
    key = jax.random.key(1)
    others = draw_interferers(key, SMALL, count=6, amplitude=300.0)
    return CUBES + crossing_chirps(key, others, SMALL)


def points_of_cells(cube):
    cells = all_cells(cube, Radar(SMALL), points=CELLS)
    return cell_points(cells, cells.power > 100, Radar(SMALL), points=CELLS)


def without_leakage(cube):
    spectrum, _ = range_doppler(cube, range_window="blackman")
    return subtract_leakage(spectrum, LEAKAGE)


def spectrum(method, **options):
    return functools.partial(method, radar=FLAT, num_azimuth=32, **options)


MAPPED = {  # functions, and what they are mapped over
    "radar_points": (lambda c: radar_points(c, Radar(SMALL), points=CELLS), CUBES),
    "cell_points": (points_of_cells, CUBES),
    "calibrate": (lambda cube: calibrate(cube, UNIT), CUBES),
    "subtract_leakage": (without_leakage, CUBES),
    "excise_interference": (excise_interference, disturbed()),
    "capon_spectrum": (spectrum(capon_spectrum), SNAPSHOTS),
    "music_spectrum": (spectrum(music_spectrum, num_sources=2), SNAPSHOTS),
}
for kind, detector in DETECTORS.items():
    MAPPED[kind] = functools.partial(detector, false_alarm_rate=0.05), POWER
ONE_FRAME = "radar_points", "cell_points"


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPPED)
def test_vmap_and_leading_axes_equal_the_loop(name):
    function, items = MAPPED[name]
    alone = jax.tree.map(lambda *each: np.stack(each), *map(function, items))
    assert any(leaf.any() for leaf in jax.tree.leaves(alone))
    tolerance = 1e-2 if "spectrum" in name else 1e-3
    close(jax.vmap(function)(items), alone, tolerance)
    if name not in ONE_FRAME:
        close(function(items), alone, tolerance)


TINY = RadarSpec.awr1843(num_chirps=8, num_samples=16)
LEAKY = Radar(TINY, leakage=jnp.full((3, 4, 8), 5 + 2j, jnp.complex64))
WINDOW = {"guard": (1, 1), "train": (1, 2), "capacity": 24, "false_alarm_rate": 0.5}
OPTIONS = (
    {"refine": False, "edge": "fill", "train": (0, 4)},
    {"detector": "ca", "edge": "reflect", "factor": 0.5, "group_peaks": True},
    {
        "detector": "go",
        "edge": "skip",
        "remove_static": True,
        "remove_interference": True,
    },
    {"detector": "so", "edge": "one_sided", "range_window": "none", "peaks": 2},
    {"edge": "wrap", "doppler_window": "hamming", "focus": True},
    {"folds": 1, "peaks": 2, "num_azimuth": 32, "num_elevation": 8},
    *({"angles": "capon"}, {"angles": "music"}, {"angles": "capon", "peaks": 2}),
    {"angles": "music", "sources": 1, "peaks": 3, "folds": 1},
)


def frames():
    """Silent, one sample, every sample at full scale, and noise: as real parts."""
    shape = (2, *TINY.cube_shape)
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
CASES[2:] = [pytest.param(*case, marks=pytest.mark.slow) for case in CASES[2:]]


@pytest.mark.parametrize(("options", "leaky"), CASES, ids=str)
def test_gradients_are_finite_whatever_was_received(options, leaky):
    radar = LEAKY if leaky else Radar(TINY)
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
    points = PointSpec(**(WINDOW | {"false_alarm_rate": 1.0}))
    for level, expected in ((0.0, False), (1.0, True)):
        cube = jnp.full(TINY.cube_shape, level, jnp.complex64)
        assert radar_points(cube, LEAKY, points=points).valid.any() == expected
