"""CFAR: exact multipliers, promised rates, brute force, invariances, clear errors."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from jradar.radar import (
    RadarSpec,
    Scatterers,
    ca_cfar,
    false_alarm_multiplier,
    go_cfar,
    largest_window,
    noise_floor,
    os_cfar,
    power_map,
    simulate_cube,
    so_cfar,
)

DETECTORS = [ca_cfar, go_cfar, so_cfar, os_cfar]
KINDS = ["ca", "go", "so", "os"]
WINDOWS = [((2, 1), (3, 4)), ((0, 2), (0, 6)), ((1, 0), (5, 0))]


@pytest.mark.parametrize("rate", [1e-2, 1e-4, 1e-6])
def test_ca_multiplier_is_the_closed_form(rate):
    expected = 16 * (rate ** (-1 / 16) - 1)
    assert false_alarm_multiplier("ca", rate, 16) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("rank", [1, 12, 16])
@pytest.mark.parametrize("rate", [0.5, 1e-3, 1e-6])
def test_os_multiplier_is_the_closed_form(rate, rank):
    alpha = false_alarm_multiplier("os", rate, 16, rank=rank)
    product = math.prod((16 - i) / (16 - i + alpha) for i in range(rank))
    assert product == pytest.approx(rate, rel=1e-8)


@pytest.mark.parametrize("rate", [1e-2, 1e-4, 1e-6])
def test_go_and_so_multipliers_are_the_closed_forms(rate):
    n = 8

    def so_rate(alpha):
        t = alpha / n
        terms = (math.comb(n - 1 + j, j) * (2 + t) ** -(n + j) for j in range(n))
        return 2 * sum(terms)

    so = false_alarm_multiplier("so", rate, 2 * n)
    assert so_rate(so) == pytest.approx(rate, rel=1e-9)
    go = false_alarm_multiplier("go", rate, 2 * n)
    # The closed form of GO is a small difference of large numbers.
    assert 2 * (1 + go / n) ** -n - so_rate(go) == pytest.approx(rate, rel=1e-7)


@pytest.mark.parametrize("kind", ["go", "so"])
def test_halves_of_other_sizes_meet_the_known_limits(kind):
    even = false_alarm_multiplier(kind, 1e-3, 16, channels=4)
    assert false_alarm_multiplier(kind, 1e-3, (8, 8), channels=4) == even
    alone = false_alarm_multiplier("ca", 1e-3, 8, channels=4)
    assert false_alarm_multiplier(kind, 1e-3, (0, 8), channels=4) == alone
    uneven = false_alarm_multiplier(kind, 1e-3, (5, 8), channels=4)
    assert uneven == false_alarm_multiplier(kind, 1e-3, (8, 5), channels=4) != even


@pytest.mark.parametrize("channels", [1, 4, 12])
def test_ca_multiplier_of_many_channels_is_a_quantile_of_f(channels):
    from scipy import stats

    alpha = false_alarm_multiplier("ca", 1e-4, 36, channels=channels)
    quantile = stats.f.isf(1e-4, 2 * channels, 2 * 36 * channels)
    assert alpha == pytest.approx(quantile, rel=1e-9)


@pytest.mark.parametrize("channels", [1, 12])
def test_smaller_half_needs_the_largest_multiplier(channels):
    go, ca, so = (
        false_alarm_multiplier(kind, 1e-4, 16, channels=channels)
        for kind in ("go", "ca", "so")
    )
    assert go < ca < so


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("channels", [1, 4, 12])
@pytest.mark.parametrize("rate", [1e-1, 1e-2])
@pytest.mark.parametrize("guard_train", [((2, 2), (4, 4)), ((0, 2), (0, 8))])
def test_false_alarm_rate_is_what_was_asked(detector, channels, rate, guard_train):
    guard, train = guard_train
    noise = jax.random.gamma(jax.random.key(channels), channels, (3000, 16, 32))
    mask = detector(
        noise, false_alarm_rate=rate, channels=channels, guard=guard, train=train
    )
    # Cells of a map share their noise estimates: only whole maps are independent.
    for part in (mask, mask[..., 0], mask[..., 3], mask[..., -1]):
        rates = part.reshape(len(mask), -1).mean(1)
        error = rates.std() / math.sqrt(len(mask))
        assert abs(rates.mean() - rate) < 4 * error


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
    for kind, detector in zip(KINDS, DETECTORS, strict=True):
        found = noise_floor(jnp.asarray(power, jnp.float32), kind=kind, **window)
        np.testing.assert_allclose(found, floors[kind], rtol=2e-6)
        mask = detector(jnp.asarray(power), false_alarm_rate=0.1, **window)
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


def test_floors_are_ordered():
    power = jax.random.exponential(jax.random.key(0), (32, 32))
    go, ca, so = (noise_floor(power, kind=kind) for kind in ("go", "ca", "so"))
    inner = (slice(None), slice(6, -6))  # where the halves are of one size
    assert (so <= ca + 1e-6)[inner].all() and (ca <= go + 1e-6)[inner].all()


@pytest.mark.parametrize("kind", KINDS)
def test_target_of_120_db_leaves_every_floor_exact(kind):
    power = np.random.default_rng(0).exponential(size=(32, 48))
    power[7, 20] = 1e12
    found = noise_floor(jnp.asarray(power, jnp.float32), kind=kind)
    with jax.enable_x64(True):
        wide = noise_floor(jnp.asarray(power, jnp.float64), kind=kind)
        if kind == "os":  # selection keeps float32
            wide = jnp.float64(np.float32(wide))
    np.testing.assert_allclose(found, wide, rtol=1e-6)


@pytest.mark.parametrize("shape", ["hann", "blackman"])
@pytest.mark.parametrize("detector", DETECTORS)
def test_windowed_noise_stays_below_one_and_a_half_times_the_rate(detector, shape):
    radar = RadarSpec.awr1843(num_chirps=64, num_samples=64)
    silence = Scatterers(jnp.ones((1, 3)), jnp.zeros(1), jnp.zeros(1))

    def count(key):
        cube = simulate_cube(key, silence, radar, noise_power=1.0)
        power = power_map(cube, range_window=shape, doppler_window=shape)
        return detector(power, false_alarm_rate=1e-2, channels=radar.num_virtual).mean()

    rates = jax.lax.map(count, jax.random.split(jax.random.key(0), 40))
    assert rates.mean() < 1.5e-2 + 4 * rates.std() / math.sqrt(40)


@pytest.mark.parametrize("detector", DETECTORS)
def test_mask_ignores_the_unit_of_power_and_shifts_with_doppler(detector):
    power = jax.random.exponential(jax.random.key(0), (32, 32))
    mask = detector(power, false_alarm_rate=0.05)
    assert mask.any() and not mask.all()
    np.testing.assert_array_equal(detector(8 * power, false_alarm_rate=0.05), mask)
    rolled = detector(jnp.roll(power, 7, 0), false_alarm_rate=0.05)
    np.testing.assert_array_equal(rolled, jnp.roll(mask, 7, 0))


@pytest.mark.parametrize("detector", DETECTORS)
def test_batch_equals_the_loop(detector):
    power = jax.random.exponential(jax.random.key(0), (3, 16, 32))
    one_by_one = [detector(p, false_alarm_rate=0.05) for p in power]
    np.testing.assert_array_equal(
        detector(power, false_alarm_rate=0.05), jnp.stack(one_by_one)
    )


@pytest.mark.parametrize("detector", DETECTORS)
def test_strong_target_leaves_its_neighbours_alone(detector):
    power = jax.random.exponential(jax.random.key(0), (32, 64))
    far = (slice(None), slice(40, None))
    with_target = detector(power.at[10, 20].set(1e12), false_alarm_rate=0.05)
    assert with_target[10, 20]
    without = detector(power, false_alarm_rate=0.05)
    np.testing.assert_array_equal(with_target[far], without[far])


@pytest.mark.parametrize("detector", DETECTORS)
def test_empty_and_constant_maps_have_no_detections(detector):
    for level in (0.0, 1.0):
        assert not detector(jnp.full((16, 32), level), false_alarm_rate=1e-3).any()


@pytest.mark.parametrize("detector", DETECTORS)
def test_rate_of_one_keeps_every_cell_that_is_not_zero(detector):
    power = jax.random.exponential(jax.random.key(0), (16, 32)).at[3, 5].set(0.0)
    mask = detector(power, false_alarm_rate=1.0)
    assert mask.sum() == 16 * 32 - 1 and not mask[3, 5]


@pytest.mark.parametrize("detector", DETECTORS)
def test_window_that_does_not_fit_names_the_largest(detector):
    with pytest.raises(
        ValueError, match=r"17 cells .* 16 Doppler .* guard \+ train = 7"
    ):
        detector(jnp.ones((16, 256)), false_alarm_rate=0.01, guard=(2, 2), train=(6, 6))
    guard, train = largest_window((16, 256), (2, 2), (6, 6))
    assert (guard, train) == ((1, 2), (6, 6))
    detector(jnp.ones((16, 256)), false_alarm_rate=0.01, guard=guard, train=train)


@pytest.mark.parametrize("rate", [0.0, -1.0, 1.5])
def test_impossible_rate_is_refused(rate):
    with pytest.raises(ValueError, match="expected 0 < rate <= 1"):
        ca_cfar(jnp.ones((16, 32)), false_alarm_rate=rate)
