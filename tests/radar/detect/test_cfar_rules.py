"""CFAR: what maps, windows and rates are taken; rules at the ends of the range axis."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.options.detectors import EDGES, largest_window
from jradar.radar import DETECTORS, ca_cfar, noise_floor
from jradar.radar.detect.cfar import cfar
from jradar.radar.detect.multipliers import false_alarm_multiplier

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
        (POWER.astype("complex64"), r"power is complex64, expected linear power: pass"),
        (POWER > 1, "power is bool, expected linear power"),
        (POWER[0], r"power has shape \(64,\), expected .*: for one profile pass power"),
    ):
        for function in (noise_floor, lambda p: ca_cfar(p, false_alarm_rate=0.1)):
            with pytest.raises(ValueError, match=message):
                function(wrong)


def test_a_window_must_have_two_whole_numbers():
    for wrong in (2, (2,), (1, 2, 3), (1.5, 2), "ab"):
        with pytest.raises(ValueError, match=r"guard = .*, expected two whole"):
            ca_cfar(POWER, false_alarm_rate=0.05, guard=wrong)


def halves_at(edge, d, r, shape, guard, train):
    """Training cells at lower range and the other ones, by the rule; None: no test."""
    sides, halves, lost = np.add(guard, train), ([], []), [0, 0]
    for i, j in itertools.product(*(range(-side, side + 1) for side in sides)):
        if abs(i) <= guard[0] and abs(j) <= guard[1]:
            continue
        half, column = int((j, i) > (0, 0)), r + j
        if edge == "wrap":
            column %= shape[1]
        elif edge == "reflect":
            column = shape[1] - 1 - abs(shape[1] - 1 - abs(column))
        if 0 <= column < shape[1]:
            halves[half].append(((d + i) % shape[0], column))
        else:
            lost[half] += 1
    if edge == "skip" and any(lost):
        return None
    if edge == "one_sided":
        halves = [[] if miss else half for half, miss in zip(halves, lost, strict=True)]
    if edge == "fill":
        halves[0].extend((d, r - sides[1] - k) for k in range(1, lost[1] + 1))
        halves[1].extend((d, r + sides[1] + k) for k in range(1, lost[0] + 1))
    return halves


RANGE_ONLY = (0, 2), (0, 4)
CASES = [(edge, *RANGE_ONLY) for edge in EDGES]
CASES += [("shrink", (2, 1), (3, 4)), ("shrink", (1, 0), (5, 0))]
CASES += [("shrink", (0, 1), (4, 7))]  # whose rows are counted in several groups
CASES += [("one_sided", (1, 1), (2, 2)), ("reflect", (1, 1), (2, 2))]


@pytest.mark.parametrize(("edge", "guard", "train"), CASES)
def test_floors_and_masks_follow_the_rule_in_a_loop_over_cells(edge, guard, train):
    power = np.random.default_rng(0).exponential(size=(16, 24)).astype("float32")
    window = {"guard": guard, "train": train, "edge": edge}
    kinds = ("ca", "os") if edge == "fill" else tuple(DETECTORS)

    @jax.jit
    def measured(power):
        return {
            kind: (
                noise_floor(power, kind=kind, **window),
                cfar(power, kind=kind, false_alarm_rate=0.1, **window),
                cfar(power, kind=kind, factor=1.5, **window),
            )
            for kind in kinds
        }

    found = jax.tree.map(np.asarray, measured(power))
    for cell in np.ndindex(power.shape):
        halves = halves_at(edge, *cell, power.shape, guard, train)
        if halves is None:
            assert not any(mask[cell] for _, *masks in found.values() for mask in masks)
            continue
        low, high = ([power[at] for at in half] for half in halves)
        every, n = sorted(low + high), len(low + high)
        means = [np.mean(half) for half in (low, high) if half]
        rank = math.ceil(0.75 * n)
        values = {"ca": np.mean(every), "go": max(means), "so": min(means)}
        values["os"] = every[rank - 1]
        for kind, (floor, *masks) in found.items():
            assert floor[cell] == pytest.approx(values[kind], rel=1e-5)
            cells = (len(low), len(high)) if kind in ("go", "so") else n
            ranked = {"rank": rank} if kind == "os" else {}
            rated = false_alarm_multiplier(kind, 0.1, cells, **ranked)
            for mask, factor in zip(masks, (rated, 1.5), strict=True):
                over = power[cell] / values[kind] / factor
                assert mask[cell] == (over > 1) or abs(over - 1) < 1e-4


def test_impossible_rules_at_the_ends_and_factors_are_refused():
    for options, message in (
        ({"edge": "mirror", "factor": 2.0}, "edge = 'mirror', expected one of"),
        ({"edge": "fill", "factor": 2.0}, r"edge='fill' .* train = \(0, cells\)"),
        ({}, "false_alarm_rate=None, factor=None: expected one of them"),
        ({"factor": 2.0, "false_alarm_rate": 0.1}, "expected one of them"),
        ({"factor": 0.0}, "factor=0.0: expected one of them, a factor of more than 0"),
        *(({"false_alarm_rate": r}, "expected 0 < rate <= 1") for r in (0.0, -1, 1.5)),
    ):
        with pytest.raises(ValueError, match=message):
            ca_cfar(POWER, **options)
