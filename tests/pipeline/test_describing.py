"""What `jradar info` says of a recording: what stands out, and what does not fit."""

from pathlib import Path

import jax
import numpy as np
import pytest

from jradar.motion.time_offset import TimeOffset
from jradar.pipeline import describe_recording, detecting
from jradar.radar import Radar, RadarSpec, Scatterers, simulate_cube
from jradar.recordings import Recording, Stream

CUBES = Stream(lambda _: None, 1)
RECORDING = Recording("walk", Path("walk"), Radar(RadarSpec.awr1843()), CUBES)


@pytest.mark.parametrize(("confidence", "given"), [(0.09, False), (0.11, True)])
def test_an_offset_of_low_confidence_is_withheld(monkeypatch, confidence, given):
    proposed = TimeOffset(0.42, confidence, "poses")
    monkeypatch.setattr(detecting, "propose_offset", lambda _: proposed)
    found = detecting.described_offset(RECORDING)
    assert (found.get("add to the radar's start (s)") == 0.42) == given
    assert ("not estimated" in found) != given


def info(radar, degrees, noise_power=1.0, amplitude=300.0):
    """What is said of a frame with two echoes, one of them at this azimuth."""
    azimuth = np.radians([0.0, degrees])
    place = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], -1) * [[3], [7]]
    targets = Scatterers(place, np.zeros(2), np.full(2, amplitude))
    cube = simulate_cube(jax.random.key(0), targets, radar, noise_power=noise_power)
    stream = Stream(lambda _: np.rint(np.asarray(cube)), 1)
    return describe_recording(Recording("walk", Path("walk"), Radar(radar), stream))


def test_echoes_where_a_board_hardly_sees():
    radar = RadarSpec.awr1843(num_chirps=16, num_samples=64)
    assert info(radar, 50)["notes"] == []
    found = info(radar, 82)
    assert max(abs(echo["azimuth_deg"]) for echo in found["echoes"]) > 75
    [note] = found["notes"]
    assert "strongest echoes lie more than 75 degrees off the middle" in note
    assert "antennas those of awr1843" in note
    assert "most of the map is noise" in found["noise"]["spread"]
    assert set(found["noise"]) == {"floor_db", "counts_per_sample", "spread"}


def test_one_chirp_has_no_doppler():
    found = info(RadarSpec.awr1843(num_chirps=1, num_samples=64), 30)
    [note] = found["notes"]
    assert "one chirp of each transmitter, and therefore no Doppler" in note
    assert {echo["velocity_mps"] for echo in found["echoes"]} == {0.0}


def test_a_map_full_of_echoes():
    radar = RadarSpec.awr1843(num_chirps=16, num_samples=64)
    found = info(radar, 30, noise_power=1e-6, amplitude=1e5)
    assert "fill much of the map" in found["noise"]["spread"]
