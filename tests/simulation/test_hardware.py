"""What a real radar gets wrong: its channels, its synthesiser, its mount."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.options.sensor import SPEED_OF_LIGHT
from jradar.radar import RadarSpec
from jradar.simulation import rig
from jradar.simulation.hardware.hardware import (
    RANGE_BIAS_M,
    Hardware,
    make_hardware,
    sample_frame,
)
from jradar.simulation.hardware.synthesiser import SynthesiserSpec, sampling_errors
from jradar.simulation.paths.link import FULL_SCALE, LINK
from jradar.simulation.paths.propagation import Paths
from tests.simulation.test_propagation import PERFECT

RADAR = RadarSpec.awr1843()
BIN = 40  # of the target, some 5 m away


def spectrum_of(hardware: Hardware):
    """[tx, rx, doppler, range] of one echo that is strong, ahead, and in one bin."""
    xyz = np.array([[BIN * RADAR.range_resolution_m, 0.0, 0.0]])
    share = (0.6 * FULL_SCALE / LINK.counts(np.ones(1))) ** 2
    paths = Paths(xyz, xyz, np.zeros(1), share)
    frame = np.asarray(sample_frame(jax.random.key(0), paths, hardware, RADAR), float)
    return np.fft.fft2(frame[..., 0] + 1j * frame[..., 1], norm="forward")


def test_phase_noise_fills_all_ranges_and_late_starts_fill_all_velocities():
    """To the data sheet's level, and to that of the starts at the echo's range."""
    power = (np.abs(spectrum_of(PERFECT)) ** 2).mean(1)
    echo = power[:, 0, BIN].mean()
    delay_s = 2 * BIN * RADAR.range_resolution_m / SPEED_OF_LIGHT
    width_hz = RADAR.sample_rate_hz / RADAR.num_samples
    away = np.r_[: BIN - 12, BIN + 13 : 128]
    offset_hz = (away - BIN) * width_hz
    density = 10**-9.3 * (1e6 / offset_hz) ** 2
    density *= 4 * np.sin(np.pi * offset_hz * delay_s) ** 2  # range correlation
    expected = (density * width_hz).mean() / RADAR.num_chirps
    noise = LINK.noise_power(RADAR) / RADAR.num_chirps / RADAR.num_samples
    measured = (power[..., away].mean() - noise) / echo
    assert 10 * np.log10(measured / expected) == pytest.approx(0, abs=0.35)
    assert measured * echo > 20 * noise
    beat_hz = BIN * RADAR.sample_rate_hz / RADAR.num_samples
    turned = 2 * np.pi * beat_hz * 1.1e-9
    measured = power[:, 1:, BIN].sum(1) / power[:, 0, BIN]
    np.testing.assert_allclose(measured, (turned / 2) ** 2, rtol=0.1)


def test_a_chirp_starts_once_at_either_edge():
    draw = jax.jit(sampling_errors, static_argnums=(1, 2))
    errors = np.asarray(draw(jax.random.key(1), RADAR, SynthesiserSpec(-300.0, 1.1e-9)))
    np.testing.assert_allclose(np.abs(errors), 0.55e-9, rtol=1e-5)
    assert abs((errors > 0).mean() - 0.5) < 0.1
    assert (np.ptp(errors, axis=-1) < 1e-15).all()


def test_imbalance_takes_power_from_the_beam_by_its_variance():
    hardware = make_hardware("single_chip", RADAR)
    channels = spectrum_of(hardware._replace(leakage=PERFECT.leakage))[:2, :, 0, BIN]
    beams = np.abs(np.fft.fft(channels.ravel())) ** 2
    factors = hardware.phase[:2]
    beside = 1 - np.abs(factors.mean()) ** 2 / (np.abs(factors) ** 2).mean()
    assert 0.01 < beside < 0.1
    assert 1 - beams[0] / beams.sum() == pytest.approx(beside, rel=0.02)


def test_an_echo_is_late_by_the_bias_of_the_board():
    hardware = make_hardware("single_chip", RADAR)._replace(leakage=PERFECT.leakage)
    spectrum = spectrum_of(hardware)[0, 0, 0]
    samples = np.fft.ifft(spectrum, norm="forward")
    turn = np.angle((samples[1:] * samples[:-1].conj()).sum()) / (2 * np.pi)
    metres = (turn * 128 - BIN) * RADAR.range_resolution_m
    assert metres == pytest.approx(RANGE_BIAS_M, abs=2e-3)


def test_a_boards_own_calibration_undoes_the_single_chips_channels(samples):
    cfg = samples / "cfg" / "radarize_ae__1843_v1.cfg"
    lines = [line.split() for line in cfg.read_text().splitlines()]
    line = next(ln for ln in lines if ln[:1] == ["compRangeBiasAndRxChanPhase"])
    mend = np.array(line[2:], float).view(complex).reshape(3, 4)
    mended = make_hardware("single_chip", RADAR).phase * mend
    mended /= mended[0, 0]
    assert np.abs(20 * np.log10(np.abs(mended))).max() < 0.5
    assert np.degrees(np.abs(np.angle(mended))).max() < 3
    assert float(line[1]) == pytest.approx(RANGE_BIAS_M, abs=1e-4)


def test_radars_are_mounted_a_degree_beside_calib(monkeypatch):
    names = tuple(f"radar {k}" for k in range(400))
    monkeypatch.setattr(rig, "MISMOUNTED", names)
    errors = np.array([rig.mount_error(name) for name in names])
    degrees = np.degrees(Rotation.from_matrix(errors[:, :3, :3]).magnitude())
    assert (degrees**2).mean() ** 0.5 == pytest.approx(1.0, rel=0.1)
    assert (errors[:, :3, 3] ** 2).sum(1).mean() ** 0.5 == pytest.approx(0.015, rel=0.1)
    np.testing.assert_array_equal(rig.mount_error("lidar"), np.eye(4))
