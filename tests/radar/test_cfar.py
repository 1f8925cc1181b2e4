"""CFAR: exact multipliers, promised rates, brute-force floors, invariances, errors."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import ca_cfar, false_alarm_multiplier, largest_window, os_cfar

DETECTORS = [ca_cfar, os_cfar]
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


@pytest.mark.parametrize("channels", [1, 12])
def test_smaller_half_needs_the_largest_multiplier(channels):
    go, ca, so = (
        false_alarm_multiplier(kind, 1e-4, 16, channels=channels)
        for kind in ("go", "ca", "so")
    )
    assert go < ca < so


@pytest.mark.parametrize("detector", DETECTORS)
@pytest.mark.parametrize("channels", [1, 12])
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
def test_masks_match_a_loop_over_cells(guard, train):
    power = np.random.default_rng(0).exponential(size=(24, 20))
    halves = [g + t for g, t in zip(guard, train, strict=True)]
    expected = {detector: np.zeros(power.shape, bool) for detector in DETECTORS}
    for d, r in np.ndindex(power.shape):
        cells = np.array(
            [
                power[(d + i) % 24, r + j]
                for i in range(-halves[0], halves[0] + 1)
                for j in range(-halves[1], halves[1] + 1)
                if 0 <= r + j < 20 and (abs(i) > guard[0] or abs(j) > guard[1])
            ]
        )
        n, k = len(cells), math.ceil(0.75 * len(cells))
        floor = cells.mean() * false_alarm_multiplier("ca", 0.1, n)
        expected[ca_cfar][d, r] = power[d, r] > floor
        floor = np.sort(cells)[k - 1] * false_alarm_multiplier("os", 0.1, n, rank=k)
        expected[os_cfar][d, r] = power[d, r] > floor
    for detector, mask in expected.items():
        found = detector(
            jnp.asarray(power), false_alarm_rate=0.1, guard=guard, train=train
        )
        np.testing.assert_array_equal(found, mask)


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
