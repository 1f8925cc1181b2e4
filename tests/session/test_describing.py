"""What `jradar info` says of a recording: an offset of clocks only if it stands out."""

import pytest

from jradar.session import describing


@pytest.mark.parametrize(("confidence", "given"), [(0.09, False), (0.11, True)])
def test_an_offset_of_low_confidence_is_withheld(monkeypatch, confidence, given):
    monkeypatch.setattr(describing, "propose_offset", lambda _: (0.42, confidence))
    found = describing._time_offset(None)
    assert (found.get("add to the radar's start (s)") == 0.42) == given
    assert ("not estimated" in found) != given
