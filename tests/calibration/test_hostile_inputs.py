"""Self-calibration in other precisions, without silent broadcasting, and with NaN."""

import jax
import numpy as np
import pytest

from jradar.calibration import self_calibrate
from jradar.calibration.self_calibration import channel_response
from tests.calibration.test_self_calibration import CHIP, channels, echoes_of

TRUE = channels(CHIP, 20.0, seed=1)
ECHOES = echoes_of(CHIP, TRUE)
MODES = {
    "double precision": lambda: jax.enable_x64(True),
    "no silent broadcasting": lambda: jax.numpy_rank_promotion("raise"),
}
REFLECTOR = (3.0, 0.1, 0.0)


def with_reflector():
    """The echoes, of which the first of each frame is the reflector's."""
    echoes = jax.tree.map(np.array, ECHOES)
    echoes.range_m[:, 0], echoes.power[:, 0] = 3.02, 10.0
    return echoes


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("reflector", [None, REFLECTOR])
def test_single_precision_echoes_give_the_same_factors(mode, reflector):
    expected = self_calibrate(with_reflector(), CHIP, reflector=reflector)
    with MODES[mode]():
        found = self_calibrate(with_reflector(), CHIP, reflector=reflector)
    assert found.improves and expected.improves
    np.testing.assert_allclose(found.factors, expected.factors, atol=1e-3)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("kind", [np.complex64, np.complex128])
@pytest.mark.parametrize("separable", [True, False])
def test_responses_keep_their_precision(mode, kind, separable):
    snapshot = np.asarray(ECHOES.snapshot).reshape(-1, CHIP.num_virtual).astype(kind)
    with MODES[mode]():
        found = channel_response(snapshot, CHIP, separable=separable)
        double = mode == "double precision" and kind == np.complex128
        assert found.dtype == (np.complex128 if double else np.complex64)


@pytest.mark.parametrize("field", ["snapshot", "range_m", "power"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_echoes_that_are_not_finite_are_left_out(field, value):
    """As if they were not there, at the end of each frame and at its beginning."""
    bad = jax.tree.map(np.array, ECHOES)
    bad.power[2, 3] = bad.power[4, 0] = 0.0
    bad.snapshot[2, 3] = bad.snapshot[4, 0] = 0.0
    expected = self_calibrate(bad, CHIP)
    bad = jax.tree.map(np.array, ECHOES)
    getattr(bad, field)[2, 3], getattr(bad, field)[4, 0] = value, value
    found = self_calibrate(bad, CHIP)
    assert found.echoes == expected.echoes == 118 and found.improves
    assert 0 < found.uncertainty_deg == expected.uncertainty_deg
    np.testing.assert_array_equal(found.factors, expected.factors)


def test_a_snapshot_with_one_value_that_is_not_finite_changes_no_response():
    snapshot = np.array(ECHOES.snapshot).reshape(-1, CHIP.num_virtual)
    snapshot[7] = 0
    expected = channel_response(snapshot, CHIP, separable=False)
    snapshot[7, 2] = np.nan
    found = channel_response(snapshot, CHIP, separable=False)
    np.testing.assert_array_equal(found, expected)


def test_a_reflector_is_not_taken_from_an_echo_that_is_not_finite():
    bad = with_reflector()
    expected = self_calibrate(bad, CHIP, reflector=REFLECTOR)
    bad.snapshot[0, 0] = np.nan
    found = self_calibrate(bad, CHIP, reflector=REFLECTOR)
    assert np.isfinite(found.factors).all()
    assert found.range_bias_m == pytest.approx(expected.range_bias_m)


def test_only_echoes_that_are_not_finite_are_none():
    bad = ECHOES._replace(snapshot=np.full_like(ECHOES.snapshot, np.nan))
    with pytest.raises(ValueError, match="0 strong echoes"):
        self_calibrate(bad, CHIP)
