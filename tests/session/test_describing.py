"""What `jradar info` says of a recording: an offset of clocks only if it stands out."""

from pathlib import Path

import pytest

from jradar.motion.time_offset import TimeOffset
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream
from jradar.session import detecting

CUBES = Stream(lambda _: None, 1)
RECORDING = Recording("walk", Path("walk"), Radar(RadarSpec.awr1843()), CUBES)


@pytest.mark.parametrize(("confidence", "given"), [(0.09, False), (0.11, True)])
def test_an_offset_of_low_confidence_is_withheld(monkeypatch, confidence, given):
    proposed = TimeOffset(0.42, confidence, "poses")
    monkeypatch.setattr(detecting, "propose_offset", lambda _: proposed)
    found = detecting.described_offset(RECORDING)
    assert (found.get("add to the radar's start (s)") == 0.42) == given
    assert ("not estimated" in found) != given
