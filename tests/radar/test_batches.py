"""Functions of one frame can be mapped, and most take leading axes: as in a loop."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    DETECTORS,
    Radar,
    all_cells,
    calibrate,
    cell_points,
    crossing_chirps,
    draw_interferers,
    excise_interference,
    radar_points,
    range_doppler,
    subtract_leakage,
)
from jradar.radar.angle.subspace import capon_spectrum, music_spectrum
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
UNIT = Radar(
    SMALL, channels=noise(3, 4), beat_bins=jnp.linspace(0, 1, 12).reshape(3, 4)
)
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


@pytest.mark.parametrize("name", MAPPED)
def test_vmap_and_leading_axes_equal_the_loop(name):
    function, items = MAPPED[name]
    alone = jax.tree.map(lambda *each: np.stack(each), *map(function, items))
    assert any(leaf.any() for leaf in jax.tree.leaves(alone))
    tolerance = 1e-2 if "spectrum" in name else 1e-3
    close(jax.vmap(function)(items), alone, tolerance)
    if name not in ONE_FRAME:
        close(function(items), alone, tolerance)
