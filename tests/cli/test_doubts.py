"""What `jradar enhance` says of a radar that its model did not train on."""

import dataclasses

import pytest

from jradar.cli import doubts
from jradar.model import load_model


@pytest.fixture(scope="module")
def spec():
    return load_model("jradar-sim").spec


def test_every_radar_of_the_training_is_known(spec):
    assert len(spec.other_radars) >= 6
    for radar in (spec.radar, *spec.other_radars):
        assert [*doubts.of_radar(spec, radar)] == []


def test_a_waveform_between_those_of_the_training_is_no_doubt(spec):
    slower = dataclasses.replace(spec.radar, slope_hz_per_s=1.1e14)
    assert [*doubts.of_radar(spec, slower)] == []
    alone = dataclasses.replace(spec, other_radars=())
    [doubt] = doubts.of_radar(alone, slower)
    assert "range bins of 0.114 m here, 0.125 in training" in doubt


def test_a_waveform_beyond_the_training_is_named_with_what_was_seen(spec):
    coarse = dataclasses.replace(spec.radar, slope_hz_per_s=2e13)
    [doubt] = doubts.of_radar(spec, coarse)
    assert "range bins of 0.625 m here, 0.0439 to 0.125 in training" in doubt


def test_an_unsure_cloud_of_an_uncalibrated_radar_names_the_mend():
    rows = [{"frame": 3, "confidence (%)": 31.0}, {"frame": 4, "confidence (%)": 70.0}]
    [known] = doubts.unsure(rows, calibrated=True)
    [unknown] = doubts.unsure(rows, calibrated=False)
    assert "do not trust frame 3 of 2:" in known and "calibrate" not in known
    assert "jradar calibrate --level" in unknown
    assert [*doubts.unsure(rows[1:], calibrated=False)] == []
