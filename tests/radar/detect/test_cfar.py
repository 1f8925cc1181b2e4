"""CFAR: multipliers in closed form, promised rates, invariances, strong targets."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jradar.radar import DETECTORS, PointSpec, detect, noise_floor, power_map
from jradar.radar.detect.correlation import independent_cells, shared_indicator
from jradar.radar.detect.multipliers import false_alarm_multiplier
from tests.radar.targets import SMALL

KINDS = [*DETECTORS]
EACH = pytest.mark.parametrize("detector", DETECTORS.values(), ids=KINDS)
POWER = jnp.asarray(np.random.default_rng(0).exponential(size=(32, 64)), jnp.float32)


def test_false_alarm_rate_is_what_was_asked():
    """All detectors, numbers of channels, rates and windows in one compiled call."""
    windows = [((2, 2), (4, 4)), ((0, 2), (0, 8))]
    rates = [(1, 1e-1), (4, 1e-2), (12, 1e-2)]
    cases = list(itertools.product(KINDS, rates, windows))

    @jax.jit
    def measured(noise):
        """Rates of each map: in all cells, and at ranges 0, 3 and the last."""
        rates = []
        for kind, (channels, rate), (guard, train) in cases:
            window = {"guard": guard, "train": train}
            options = {"false_alarm_rate": rate, "channels": channels}
            mask = DETECTORS[kind](noise[channels], **options, **window)
            parts = mask, mask[..., 0], mask[..., 3], mask[..., -1]
            rates.append([part.reshape(len(part), -1).mean(1) for part in parts])
        return jnp.asarray(rates)

    shape = (1500, 16, 32)
    rng = np.random.default_rng(0)
    noise = {n: rng.standard_gamma(n, shape, dtype="float32") for n, _ in rates}
    for case, parts in zip(cases, np.asarray(measured(noise)), strict=True):
        # Cells of a map share their noise estimates: only whole maps are independent.
        error = parts.std(1) / math.sqrt(shape[0])
        assert (abs(parts.mean(1) - case[1][1]) < 4 * error).all(), case


def test_floors_are_ordered_and_exact_next_to_a_target_of_120_db():
    floors_of = jax.jit(lambda p: {kind: noise_floor(p, kind=kind) for kind in KINDS})
    power = np.random.default_rng(0).exponential(size=(32, 48))
    power[7, 20] = 1e12
    found = jax.tree.map(np.asarray, floors_of(jnp.asarray(power, jnp.float32)))
    inner = (slice(None), slice(6, -6))  # where the halves have the same size
    assert (found["so"] <= found["ca"] * (1 + 1e-6))[inner].all()
    assert (found["ca"] <= found["go"] * (1 + 1e-6))[inner].all()
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
    kinds = {"range_window": shape, "doppler_window": shape}
    points = PointSpec(false_alarm_rate=1e-2, detector="go", **kinds)

    def rates_of(key):
        noise = jax.lax.complex(*jax.random.normal(key, (2, 3, 4, 64, 64)))
        power = power_map(noise, range_window=shape, doppler_window=shape)
        options = {"false_alarm_rate": 1e-2, "channels": 12, "windows": (shape, shape)}
        masks = [
            DETECTORS[kind](power, guard=guard, train=train, **options)
            for kind, (guard, train) in cases
        ]
        same = (detect(power, SMALL, points=points) == masks[2]).all()
        return jnp.array([mask.mean() for mask in masks]), same

    rates, same = jax.lax.map(rates_of, jax.random.split(jax.random.key(0), 60))
    rates = np.asarray(rates) / 1e-2
    error = 4 * rates.std(0) / math.sqrt(60)
    mean = rates.mean(0)
    assert (mean < 1.2 + error).all() and (mean > 1 / 1.2 - error).all()
    assert error.max() < 0.2
    assert same.all()  # `detect` takes channels and windows from the radar and the spec


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


@EACH
def test_masks_ignore_the_unit_shift_with_doppler_and_stay_beside_a_target(detector):
    def mask_of(power):
        return np.asarray(detector(power, false_alarm_rate=0.05))

    mask = mask_of(POWER)
    assert mask.any() and not mask.all()
    np.testing.assert_array_equal(mask_of(8 * POWER), mask)
    np.testing.assert_array_equal(mask_of(jnp.roll(POWER, 7, 0)), np.roll(mask, 7, 0))
    with_target = mask_of(POWER.at[10, 20].set(1e12))
    assert with_target[10, 20]
    np.testing.assert_array_equal(with_target[:, 40:], mask[:, 40:])
    for level in (0.0, 1.0):
        assert not mask_of(jnp.full((32, 64), level)).any()


@EACH
def test_rate_of_one_keeps_every_cell_that_is_not_zero(detector):
    mask = detector(POWER.at[3, 5].set(0.0), false_alarm_rate=1.0)
    assert mask.sum() == 32 * 64 - 1 and not mask[3, 5]


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


@pytest.mark.parametrize("rate", [1e-2, 1e-6])
@pytest.mark.parametrize("channels", [1, 4, 12])
def test_ca_multiplier_is_a_quantile_of_f(channels, rate):
    alpha = false_alarm_multiplier("ca", rate, 36, channels=channels)
    quantile = stats.f.isf(rate, 2 * channels, 2 * 36 * channels)
    assert alpha == pytest.approx(quantile, rel=1e-9)
