"""Multipliers of CFAR detectors against closed forms, quantiles and limits."""

import math

import pytest
from scipy import stats

from jradar.radar import false_alarm_multiplier


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
    alpha = false_alarm_multiplier("ca", 1e-4, 36, channels=channels)
    quantile = stats.f.isf(1e-4, 2 * channels, 2 * 36 * channels)
    assert alpha == pytest.approx(quantile, rel=1e-9)
