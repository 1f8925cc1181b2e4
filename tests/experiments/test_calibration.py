"""The study of calibration: errors in closed form, boards that are found again."""

import numpy as np
import pytest

from experiments.studies import calibration
from experiments.studies.calibration import calibrations, phase_error
from jradar.radar import RadarSpec
from jradar.simulation import shifted_unit

CHIP = RadarSpec.awr1843()


@pytest.mark.parametrize("tilt_deg", [-9.0, 0.0, 12.0])
def test_a_linear_phase_is_a_tilt_and_nothing_else(tilt_deg):
    rows = CHIP.virtual_positions[:, 1]
    sine = np.sin(np.radians(tilt_deg))
    channels = 2.0 * np.exp(2j * np.pi * CHIP.row_spacing_wavelengths * sine * rows)
    error = phase_error(np.ones(CHIP.num_virtual), channels, CHIP)
    assert error.tilt == pytest.approx(tilt_deg, abs=0.01)
    assert error.curved < 0.01 and (error.total > 1) == (tilt_deg != 0)


def test_factors_that_undo_the_channels_leave_no_error():
    random = np.random.default_rng(0)
    channels = np.exp(1j * random.uniform(-1, 1, CHIP.num_virtual))
    left = phase_error(1 / channels, channels, CHIP)
    np.testing.assert_allclose(left, 0, atol=1e-6)
    before = phase_error(np.ones(CHIP.num_virtual), channels, CHIP)
    assert before.total >= before.curved > 10


def test_a_walk_finds_the_channels_and_a_reflector_the_tilt():
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    unit = shifted_unit("board-a")
    found = calibrations(unit, frames=20)
    channels = 1 / found["true"].factors
    error = {
        name: phase_error(calibration.factors, channels, CHIP)
        for name, calibration in found.items()
    }
    assert error["none"].curved > 5 > 1 > error["walk"].curved
    assert error["walk"].tilt == pytest.approx(error["none"].tilt, abs=0.5)
    assert abs(error["level"].tilt) < 4 < abs(error["walk"].tilt)
    assert abs(error["reflector"].tilt) < 0.5 < abs(error["walk"].tilt)
    assert error["reflector"].total < 1
    assert found["reflector"].range_bias_m == pytest.approx(unit.range_bias_m, abs=0.01)


def test_gains_stand_beside_the_row_without_calibration():
    before = np.array([[1.0, 0.4], [np.nan, 0.2], [2.0, 0.6]])
    after = before - [0.5, 0.0] + [0.0, 0.1]
    cells = calibration.cells_of({"none": before, "walk": after})
    assert cells["none"] == ["1.50", "40.0", ""]
    assert cells["walk"] == ["1.00", "50.0", "+10.0 ± 0.0"]
