"""Every kernel traces in double precision and without silent broadcasting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import radar as r, range_image as ri
from jradar.calibration.self_calibration import explain
from jradar.calibration.snapshots import strong_snapshots
from jradar.metrics import compare, compare_on_host, nearest_distances
from jradar.motion import ego_velocity
from jradar.radar import Radar
from jradar.radar.angle.folds import velocity_folds
from jradar.radar.angle.near_field import focused_directions
from jradar.radar.angle.spectrum import spectrum_peaks
from jradar.radar.angle.subspace import (
    capon_spectrum,
    music_spectrum,
    subspace_directions,
)
from jradar.radar.angle.subspace_peaks import subspace_peaks
from jradar.radar.clean.interference import crossing_chirps
from jradar.radar.detect.clusters import map_peaks
from jradar.radar.peaks import window_offset
from jradar.range_image.projection import project_slices
from jradar.types import PointCloud

CHIP = r.RadarSpec.awr1843(num_chirps=16, num_samples=32)
CASCADE = r.RadarSpec.cascade()
SPEC = ri.ImageSpec(8, 16)
WINDOW = {"guard": (1, 1), "train": (2, 2)}
POINTS = {
    "plain": r.PointSpec(**WINDOW, capacity=64),
    "two peaks": r.PointSpec(**WINDOW, capacity=64, peaks=2),
    "music": r.PointSpec(**WINDOW, capacity=64, angles="music"),
    "capon, peaks": r.PointSpec(**WINDOW, capacity=9, angles="capon", group_peaks=True),
    "music, folds": r.PointSpec(**WINDOW, capacity=64, angles="music", folds=1),
    "two peaks, folds": r.PointSpec(**WINDOW, capacity=64, peaks=2, folds=1),
    "two peaks, capon": r.PointSpec(**WINDOW, capacity=64, peaks=2, angles="capon"),
    "focus": r.PointSpec(**WINDOW, capacity=64, focus=True),
    "static": r.PointSpec(**WINDOW, remove_static=True, remove_interference=True),
}
UNIT, PLAIN = Radar(CHIP), POINTS["plain"]
RATE = {"false_alarm_rate": 0.1, "channels": 12, "windows": ("hann", "hann")}


def key():
    return jax.random.key(0)


def numbers(*shape):
    """Real numbers in the precision that is switched on."""
    rng = np.random.default_rng(0)
    return jnp.asarray(rng.normal(size=shape), jnp.zeros(()).dtype)


def waves(*shape):
    """Complex numbers."""
    return jax.lax.complex(numbers(*shape), numbers(*shape))


def cube():
    return waves(*CHIP.cube_shape)


def power():
    return jnp.abs(numbers(16, 32))


def image():
    return jnp.abs(numbers(8, 16))


def cloud(count=40):
    xyz = numbers(count, 3) + jnp.array([[4.0, 0.0, 0.0]])
    return PointCloud(xyz, xyz[:, 0] > 0, power=jnp.abs(xyz[:, 1]))


def scatterers():
    return r.Scatterers(numbers(5, 3), numbers(5), numbers(5), numbers(5, 3))


KERNELS = {
    "simulate_cube": lambda: r.simulate_cube(key(), scatterers(), CHIP),
    "range_doppler": lambda: r.range_doppler(cube()),
    "range_doppler, real": lambda: r.range_doppler(cube().real),
    "power_map": lambda: r.power_map(cube(), remove_static=True),
    "calibrate": lambda: r.calibrate(cube(), UNIT.with_factors(waves(12))),
    "calibrate, real": lambda: r.calibrate(cube().real, UNIT.with_factors(waves(12))),
    "calibrate, beats": lambda: r.calibrate(
        cube(), r.Radar(CHIP, channels=waves(3, 4), beat_bins=numbers(3, 4))
    ),
    "compensate_tdm": lambda: r.compensate_tdm(waves(5, 12), numbers(5), CHIP),
    "subtract_leakage": lambda: r.subtract_leakage(waves(12, 16, 32), waves(3, 4, 16)),
    **{
        f"{kind}_cfar": lambda kind=kind: r.DETECTORS[kind](power(), **WINDOW, **RATE)
        for kind in r.DETECTORS
    },
    **{
        f"noise_floor, {kind}": lambda kind=kind: r.noise_floor(
            power(), kind=kind, **WINDOW
        )
        for kind in r.DETECTORS
    },
    **{
        f"radar_points, {name}": lambda spec=spec: r.radar_points(
            cube(), Radar(CHIP, leakage=waves(3, 4, 16)), points=spec
        )
        for name, spec in POINTS.items()
    },
    "points_and_count": lambda: r.points_and_count(cube(), UNIT, points=PLAIN),
    "all_cells": lambda: r.cell_points(
        r.all_cells(cube(), UNIT, points=PLAIN), power() > 1, UNIT, points=PLAIN
    ),
    "angle_spectrum": lambda: r.angle_spectrum(waves(3, 12), CHIP),
    "spectrum_peaks": lambda: spectrum_peaks(numbers(3, 32, 64), CHIP),
    "directions": lambda: r.directions(waves(300, 12), CHIP),
    "directions, four rows": lambda: r.directions(
        waves(3, 192), CASCADE, num_azimuth=128
    ),
    "capon_spectrum": lambda: capon_spectrum(waves(2, 1, 12), CHIP),
    "music_spectrum": lambda: music_spectrum(waves(2, 1, 12), CHIP, num_sources=2),
    "subspace_directions": lambda: subspace_directions(
        waves(2, 12), CHIP, method="music"
    ),
    "subspace_peaks": lambda: subspace_peaks(waves(2, 12), CHIP, method="music"),
    "velocity_folds": lambda: velocity_folds(waves(2, 12), numbers(2), CHIP, most=2),
    "focused_directions": lambda: focused_directions(
        waves(2, 3, 12), jnp.array([5, 9]), numbers(2) / 8, CHIP
    ),
    "map_peaks": lambda: map_peaks(power()),
    "window_offset": lambda: window_offset(
        *jnp.abs(numbers(3, 7)), kind="hann", length=32
    ),
    "point_deviations": lambda: r.point_deviations(
        cloud()._replace(snr=jnp.abs(numbers(40)) + 2), CHIP
    ),
    "ego_velocity": lambda: ego_velocity(
        key(), cloud()._replace(velocity=numbers(40)), unambiguous_mps=2.0
    ),
    "ego_velocity, one row": lambda: ego_velocity(
        key(), cloud()._replace(velocity=numbers(40)), elevation=False
    ),
    "subtract_background": lambda: r.subtract_background(
        cube(), r.static_background([cube()])
    ),
    "excise_interference": lambda: r.excise_interference(cube()),
    "crossing_chirps": lambda: crossing_chirps(
        key(), r.draw_interferers(key(), CHIP, count=2, amplitude=3.0), CHIP
    ),
    "strong_snapshots": lambda: strong_snapshots(cube(), UNIT),
    "explain": lambda: explain(waves(4, 12), waves(12), CHIP),
    "project": lambda: ri.unproject(ri.project(cloud(), SPEC), SPEC),
    "project_slices": lambda: project_slices(cloud(), SPEC, num_slices=4),
    "condition_image": lambda: ri.condition_image(cloud(), SPEC, num_slices=4),
    "encode_target": lambda: ri.decode_target(ri.encode_target(image(), SPEC), SPEC),
    "close_gaps": lambda: ri.close_gaps(image()),
    "agreed_range": lambda: ri.agreed_range(jnp.abs(numbers(3, 8, 16))),
    "compare": lambda: compare(cloud(30), cloud(20)),
    "compare, many points": lambda: compare(cloud(1100), cloud(1300)),
    "compare, a batch": lambda: jax.vmap(compare)(
        *(jax.tree.map(lambda x: x[None], cloud(n)) for n in (1100, 1000))
    ),
}


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_trace_in_double_precision_without_silent_broadcasting(name):
    with jax.enable_x64(True), jax.numpy_rank_promotion("raise"):
        jax.eval_shape(KERNELS[name])


@pytest.mark.slow
def test_distances_of_many_points_are_exact_in_double_precision():
    with jax.enable_x64(True):
        a, b = cloud(1100), cloud(1300)
        found = map(np.asarray, nearest_distances(a, b))
    forth, back = (distance[~np.isnan(distance)] for distance in found)
    points = [np.asarray(c.xyz)[np.asarray(c.valid)] for c in (a, b)]
    expected = compare_on_host(*points)
    assert forth.dtype == np.float64
    np.testing.assert_allclose(forth.mean() + back.mean(), expected.chamfer, rtol=1e-12)
    worst = max(np.median(forth), np.median(back))
    np.testing.assert_allclose(worst, expected.modified_hausdorff, rtol=1e-12)
