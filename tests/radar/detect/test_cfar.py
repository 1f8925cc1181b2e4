"""CFAR: promised rates, brute force, invariances, clear errors."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from jradar.radar import (
    PointSpec,
    RadarSpec,
    ca_cfar,
    detect,
    false_alarm_multiplier,
    go_cfar,
    noise_floor,
    os_cfar,
    power_map,
    so_cfar,
)
from jradar.radar.detect.correlation import independent_cells, shared_indicator

CFARS = [ca_cfar, go_cfar, so_cfar, os_cfar]
KINDS = ["ca", "go", "so", "os"]
DETECTORS = dict(zip(KINDS, CFARS, strict=True))
EACH = pytest.mark.parametrize("detector", CFARS)
WINDOWS = [((2, 1), (3, 4)), ((0, 2), (0, 6)), ((1, 0), (5, 0))]


def test_false_alarm_rate_is_what_was_asked():
    """All detectors, numbers of channels, rates and windows in one compiled call."""
    windows = [((2, 2), (4, 4)), ((0, 2), (0, 8))]
    cases = list(itertools.product(KINDS, (1, 4, 12), (1e-1, 1e-2), windows))

    @jax.jit
    def measured(noise):
        """Rates of each map: in all cells, and at ranges 0, 3 and the last."""
        rates = []
        for kind, channels, rate, (guard, train) in cases:
            mask = DETECTORS[kind](
                noise[channels],
                false_alarm_rate=rate,
                channels=channels,
                guard=guard,
                train=train,
            )
            parts = mask, mask[..., 0], mask[..., 3], mask[..., -1]
            rates.append([part.reshape(len(part), -1).mean(1) for part in parts])
        return jnp.asarray(rates)

    shape = (3000, 16, 32)
    rng = np.random.default_rng(0)
    noise = {n: rng.standard_gamma(n, shape).astype("float32") for n in (1, 4, 12)}
    for case, parts in zip(cases, np.asarray(measured(noise)), strict=True):
        # Cells of a map share their noise estimates: only whole maps are independent.
        error = parts.std(1) / math.sqrt(shape[0])
        assert (abs(parts.mean(1) - case[2]) < 4 * error).all(), case


@pytest.mark.parametrize(("guard", "train"), WINDOWS)
def test_floors_and_masks_match_a_loop_over_cells(guard, train):
    power = np.random.default_rng(0).exponential(size=(24, 20))
    sides = [g + t for g, t in zip(guard, train, strict=True)]
    floors = {kind: np.zeros(power.shape) for kind in KINDS}
    multipliers = {kind: np.zeros(20) for kind in KINDS}
    for d, r in np.ndindex(power.shape):
        cells = {
            (i, j): power[(d + i) % 24, r + j]
            for i in range(-sides[0], sides[0] + 1)
            for j in range(-sides[1], sides[1] + 1)
            if 0 <= r + j < 20 and (abs(i) > guard[0] or abs(j) > guard[1])
        }
        low = [x for (i, j), x in cells.items() if (j, i) < (0, 0)]
        high = [x for (i, j), x in cells.items() if (j, i) > (0, 0)]
        means = [np.mean(half) for half in (low, high) if half]
        everything, n = sorted(cells.values()), len(cells)
        k = math.ceil(0.75 * n)
        values = (np.mean(everything), max(means), min(means), everything[k - 1])
        for kind, floor in zip(KINDS, values, strict=True):
            floors[kind][d, r] = floor
            multipliers[kind][r] = false_alarm_multiplier(
                kind,
                0.1,
                (len(low), len(high)) if kind in ("go", "so") else n,
                rank=k if kind == "os" else None,
            )
    window = {"guard": guard, "train": train}

    @jax.jit
    def floor_and_mask(power):
        return {
            kind: (
                noise_floor(power, kind=kind, **window),
                detector(power, false_alarm_rate=0.1, **window),
            )
            for kind, detector in DETECTORS.items()
        }

    for kind, (floor, mask) in floor_and_mask(jnp.asarray(power, "float32")).items():
        np.testing.assert_allclose(floor, floors[kind], rtol=2e-6)
        np.testing.assert_array_equal(mask, power > multipliers[kind] * floors[kind])


@pytest.mark.parametrize("train", [(3, 3), (0, 6), (7, 7)])
def test_ordered_floor_is_the_rank_filters_to_the_bit(train):
    power = np.asarray(jax.random.exponential(jax.random.key(0), (32, 48)))
    guard = (1, 1) if train[0] else (0, 1)
    footprint = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)])
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    footprint[tuple(hole)] = 0
    k = math.ceil(0.75 * footprint.sum())
    expected = ndimage.rank_filter(power, k - 1, footprint=footprint, mode="wrap")
    found = noise_floor(power, kind="os", guard=guard, train=train)
    side = guard[1] + train[1]  # the range axis does not wrap around
    np.testing.assert_array_equal(found[:, side:-side], expected[:, side:-side])


@jax.jit
def floors_of(power):
    return {kind: noise_floor(power, kind=kind) for kind in KINDS}


def test_floors_are_ordered():
    floors = floors_of(jax.random.exponential(jax.random.key(0), (32, 48)))
    inner = (slice(None), slice(6, -6))  # where the halves have the same size
    assert (floors["so"] <= floors["ca"] + 1e-6)[inner].all()
    assert (floors["ca"] <= floors["go"] + 1e-6)[inner].all()


def test_target_of_120_db_leaves_every_floor_exact():
    power = np.random.default_rng(0).exponential(size=(32, 48))
    power[7, 20] = 1e12
    found = floors_of(jnp.asarray(power, jnp.float32))
    with jax.enable_x64(True):
        exact = jax.tree.map(np.asarray, floors_of(jnp.asarray(power, jnp.float64)))
    exact["os"] = np.float32(exact["os"])  # selection keeps float32
    for kind in KINDS:
        np.testing.assert_allclose(found[kind], exact[kind], rtol=1e-6)


@pytest.mark.parametrize("shape", ["hann", "blackman"])
def test_windowed_noise_is_detected_at_the_rate_that_was_asked(shape):
    """Within 1.2 times, for all detectors in one compiled call."""
    windows = [((2, 2), (4, 4)), ((0, 3), (0, 8))]
    cases = list(itertools.product(KINDS, windows))

    def count(key):
        noise = jax.lax.complex(*jax.random.normal(key, (2, 3, 4, 64, 64)))
        power = power_map(noise, range_window=shape, doppler_window=shape)
        options = {"false_alarm_rate": 1e-2, "channels": 12, "windows": (shape, shape)}
        return jnp.array(
            [
                DETECTORS[kind](power, guard=guard, train=train, **options).mean()
                for kind, (guard, train) in cases
            ]
        )

    rates = jax.lax.map(count, jax.random.split(jax.random.key(0), 60)) / 1e-2
    error = 4 * np.asarray(rates.std(0)) / math.sqrt(60)
    mean = np.asarray(rates.mean(0))
    assert (mean < 1.2 + error).all() and (mean > 1 / 1.2 - error).all()
    assert error.max() < 0.2


@pytest.mark.parametrize("kind", KINDS)
def test_detections_of_noise_by_a_point_spec_have_its_rate(kind):
    radar = RadarSpec.awr1843(num_chirps=64, num_samples=64)
    points = PointSpec(detector=kind, false_alarm_rate=1e-2)

    def count(key):
        noise = jax.lax.complex(*jax.random.normal(key, (2, *radar.cube_shape)))
        return detect(power_map(noise), radar, points=points).mean()

    rates = jax.lax.map(count, jax.random.split(jax.random.key(1), 60)) / 1e-2
    error = 4 * float(rates.std()) / math.sqrt(60)
    assert 1 / 1.2 - error < rates.mean() < 1.2 + error < 1.4


def test_without_a_window_all_cells_are_independent():
    mask = np.ones((3, 5), bool)
    assert independent_cells(mask, ("none", "none"), (16, 32)) == 15
    fewer = independent_cells(mask, ("hann", "hann"), (16, 32))
    doppler = 3 + 2 * (2 * 4 / 9 + 1 / 36)
    range_ = 5 + 2 * (4 * 4 / 9 + 3 / 36)
    assert fewer == pytest.approx(15**2 / (doppler * range_))
    assert independent_cells(np.zeros((3, 5), bool), ("hann", "hann"), (16, 32)) == 0


def test_correlation_of_indicators_is_that_of_normal_pairs():
    rng = np.random.default_rng(0)
    one, other = rng.standard_normal((2, 1_000_000))
    other = 0.6 * one + 0.8 * other
    limit = np.quantile(one, 0.75)
    measured = np.corrcoef(one < limit, other < limit)[0, 1]
    assert shared_indicator(0.6, 0.75) == pytest.approx(measured, abs=0.005)
    assert shared_indicator(1.0, 0.75) == 1.0 and shared_indicator(0.0, 0.75) == 0.0


POWER = jax.random.exponential(jax.random.key(0), (32, 64))


@EACH
def test_mask_ignores_the_unit_of_power_and_shifts_with_doppler(detector):
    mask = detector(POWER, false_alarm_rate=0.05)
    assert mask.any() and not mask.all()
    np.testing.assert_array_equal(detector(8 * POWER, false_alarm_rate=0.05), mask)
    rolled = detector(jnp.roll(POWER, 7, 0), false_alarm_rate=0.05)
    np.testing.assert_array_equal(rolled, jnp.roll(mask, 7, 0))


@EACH
def test_batch_equals_the_loop(detector):
    power = jnp.stack([POWER, POWER[::-1], POWER[:, ::-1]])
    one_by_one = [detector(p, false_alarm_rate=0.05) for p in power]
    np.testing.assert_array_equal(
        detector(power, false_alarm_rate=0.05), jnp.stack(one_by_one)
    )


@EACH
def test_strong_target_leaves_its_neighbours_alone(detector):
    far = (slice(None), slice(40, None))
    with_target = detector(POWER.at[10, 20].set(1e12), false_alarm_rate=0.05)
    assert with_target[10, 20]
    without = detector(POWER, false_alarm_rate=0.05)
    np.testing.assert_array_equal(with_target[far], without[far])


@EACH
def test_empty_and_constant_maps_have_no_detections(detector):
    for level in (0.0, 1.0):
        assert not detector(jnp.full((32, 64), level), false_alarm_rate=0.05).any()


@EACH
def test_rate_of_one_keeps_every_cell_that_is_not_zero(detector):
    mask = detector(POWER.at[3, 5].set(0.0), false_alarm_rate=1.0)
    assert mask.sum() == 32 * 64 - 1 and not mask[3, 5]
