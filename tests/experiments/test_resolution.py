"""The picture of two close targets: one peak by FFT, two by Capon and MUSIC."""

import numpy as np
from PIL import Image

from experiments.studies import resolution
from jradar.radar import RadarSpec, direction_sines


def test_only_capon_and_music_tell_the_targets_apart():
    radar, targets = RadarSpec.awr1843(num_chirps=16), (4.5, -4.5)
    assert targets[0] - targets[1] < resolution.beam_width_deg(radar)
    spectra = resolution.two_target_spectra(radar, targets, snr_db=40.0)
    u, _ = direction_sines(radar, num_azimuth=resolution.NUM_AZIMUTH)
    found = {}
    for name, power in spectra._asdict().items():
        inner = power[1:-1]
        peak = (inner > power[:-2]) & (inner > power[2:]) & (inner > power.max() / 10)
        found[name] = np.degrees(np.arcsin(u[1:-1][peak]))
    assert len(found["fourier"]) == 1
    for name in ("capon", "music"):
        np.testing.assert_allclose(found[name], sorted(targets), atol=0.5)


def test_picture_is_written(tmp_path):
    assert resolution.main(["-o", str(tmp_path / "angles.png")]) == 0
    assert min(Image.open(tmp_path / "angles.png").size) > 300
