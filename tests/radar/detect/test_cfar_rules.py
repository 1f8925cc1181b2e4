"""CFAR: what maps, windows and rates are taken; rules at the ends of the range axis."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import DETECTORS, ca_cfar, noise_floor
from jradar.radar.detect.cfar import cfar
from jradar.radar.detect.cfar_window import EDGES, largest_window

EACH = pytest.mark.parametrize("detector", DETECTORS.values(), ids=[*DETECTORS])
POWER = np.random.default_rng(0).exponential(size=(32, 64)).astype("float32")


@EACH
def test_window_that_does_not_fit_names_the_largest(detector):
    power = jnp.ones((16, 256))
    message = r"17 cells .* 16 Doppler .* guard \+ train = 7"
    with pytest.raises(ValueError, match=message):
        detector(power, false_alarm_rate=0.01, guard=(2, 2), train=(6, 6))
    guard, train = largest_window((16, 256), (2, 2), (6, 6))
    assert (guard, train) == ((1, 2), (6, 6))
    window = {"guard": guard, "train": train}
    fitted = jax.eval_shape(lambda p: detector(p, factor=2.0, **window), power)
    assert fitted.shape == power.shape


@EACH
@pytest.mark.parametrize("kind", ["uint16", "bfloat16"])
def test_maps_of_other_numbers_give_the_masks_of_float32(detector, kind):
    """TI's boards deliver uint16. Each kind holds the powers, which are whole."""
    whole = np.random.default_rng(0).integers(1, 60, (32, 64))
    whole[5, 7], whole[20, 40] = 250, 240
    expected, found = (
        np.asarray(detector(jnp.asarray(whole, k), false_alarm_rate=0.01))
        for k in ("float32", kind)
    )
    assert expected[5, 7] and not expected.all()
    np.testing.assert_array_equal(found, expected)


def test_power_that_half_precision_cannot_add_up_is_added_in_float32():
    power = jnp.full((16, 64), 6e4, jnp.float16)
    np.testing.assert_allclose(noise_floor(power), float(power[0, 0]), rtol=1e-6)
    assert not ca_cfar(power, false_alarm_rate=0.05).any()


@pytest.mark.usefixtures("as_a_user")
def test_maps_that_hold_no_power_are_refused():
    for wrong, message in (
        (
            POWER.astype("complex64"),
            r"power is complex64, expected linear power: pass abs",
        ),
        (POWER > 1, "power is bool, expected linear power"),
        (POWER[0], r"power has shape \(64,\), expected .*: for one profile pass power"),
    ):
        for function in (noise_floor, lambda p: ca_cfar(p, false_alarm_rate=0.1)):
            with pytest.raises(ValueError, match=message):
                function(wrong)


def cells_at(edge, r, g, t, bins):
    """Range bins of the low and the high half of a window along range."""
    low, high = [*range(r - g - t, r - g)], [*range(r + g + 1, r + g + t + 1)]
    if edge == "wrap":
        low, high = ([i % bins for i in half] for half in (low, high))
    elif edge == "reflect":
        low = [abs(i) for i in low]
        high = [i if i < bins else 2 * (bins - 1) - i for i in high]
    elif edge == "one_sided":
        low = low if low[0] >= 0 else []
        high = high if high[-1] < bins else []
    elif edge == "fill":
        lost_low, lost_high = sum(i < 0 for i in low), sum(i >= bins for i in high)
        low = [*range(r - g - t - lost_high, r - g)]
        high = [*range(r + g + 1, r + g + t + 1 + lost_low)]
    halves = [[i for i in half if 0 <= i < bins] for half in (low, high)]
    return halves if edge != "skip" or len(sum(halves, [])) == 2 * t else None


@pytest.mark.parametrize("edge", EDGES)
def test_ends_of_the_range_axis_follow_the_rule(edge):
    """Floors and masks along range against a loop over cells."""
    power = np.random.default_rng(0).exponential(size=(2, 24)).astype("float32")
    window = {"guard": (0, 2), "train": (0, 4), "edge": edge}
    kinds = ("ca", "os") if edge == "fill" else DETECTORS
    floors = jax.jit(lambda p: {k: noise_floor(p, kind=k, **window) for k in kinds})
    masks = jax.jit(lambda p: {k: cfar(p, kind=k, factor=1.5, **window) for k in kinds})
    found, detected = floors(jnp.asarray(power)), masks(jnp.asarray(power))
    for row, r in np.ndindex(power.shape):
        halves = cells_at(edge, r, 2, 4, 24)
        if halves is None:
            assert not any(mask[row, r] for mask in detected.values())
            continue
        sides = [power[row, half].mean() for half in halves if half]
        every = sorted(power[row, sum(halves, [])])
        values = {"ca": np.mean(every), "go": max(sides), "so": min(sides)}
        values["os"] = every[math.ceil(0.75 * len(every)) - 1]
        for kind in kinds:
            assert found[kind][row, r] == pytest.approx(values[kind], rel=1e-5)
            if abs(power[row, r] / values[kind] / 1.5 - 1) > 1e-4:
                assert detected[kind][row, r] == (power[row, r] > 1.5 * values[kind])


def test_one_sided_windows_in_two_dimensions_leave_out_the_incomplete_half():
    power = np.random.default_rng(0).exponential(size=(16, 24)).astype("float32")
    window = {"guard": (1, 1), "train": (2, 2), "edge": "one_sided"}
    low = [(d, r) for d in range(-3, 4) for r in range(-3, 1) if (r, d) < (0, 0)]
    low = [(d, r) for d, r in low if abs(d) > 1 or abs(r) > 1]
    expected = {"ca": np.mean, "os": lambda x: np.sort(x)[math.ceil(0.75 * len(x)) - 1]}
    for kind, estimate in expected.items():
        floor = noise_floor(jnp.asarray(power), kind=kind, **window)
        for d in (0, 7, 15):
            cells = np.array([power[(d + i) % 16, 22 + j] for i, j in low])
            assert floor[d, 22] == pytest.approx(estimate(cells), rel=1e-5)


@pytest.mark.parametrize("edge", ["one_sided", "fill", "skip"])
def test_rates_hold_at_the_ends_under_every_rule(edge):
    noise = np.random.default_rng(0).standard_gamma(4, (3000, 4, 24)).astype("float32")
    window = {"guard": (0, 2), "train": (0, 4), "edge": edge, "channels": 4}
    for kind in ("ca", "os"):
        mask = cfar(jnp.asarray(noise), kind=kind, false_alarm_rate=0.05, **window)
        for r in (0, 3, 23):
            rate, asked = float(mask[..., r].mean()), 0.0 if edge == "skip" else 0.05
            assert abs(rate - asked) < 4 * math.sqrt(0.05 / 12000)


def test_impossible_rules_at_the_ends_and_factors_are_refused():
    for options, message in (
        ({"edge": "mirror", "factor": 2.0}, "edge='mirror', expected one of"),
        ({"edge": "fill", "factor": 2.0}, r"edge='fill' .* train = \(0, cells\)"),
        ({}, "false_alarm_rate=None, factor=None: expected one of them"),
        ({"factor": 2.0, "false_alarm_rate": 0.1}, "expected one of them"),
        ({"factor": 0.0}, "factor=0.0: expected one of them, a factor of more than 0"),
        *(({"false_alarm_rate": r}, "expected 0 < rate <= 1") for r in (0.0, -1, 1.5)),
    ):
        with pytest.raises(ValueError, match=message):
            ca_cfar(POWER, **options)
