"""Units: what is drawn for each, what their files say, and what disturbs them."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.radar import RadarSpec, calibrate
from jradar.recordings import open_recording
from jradar.simulation import simulate_sequence
from jradar.simulation.hardware.front_end import distort, make_front_end, phase_drift
from jradar.simulation.hardware.hardware import make_unit_hardware, sample_frame
from jradar.simulation.paths.clutter import CELL_M, diffuse_clutter
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.propagation import Paths
from jradar.simulation.rig import Viewpoint, described_mount
from jradar.simulation.scenes.trajectory import mounted, pose_at, velocity_at
from jradar.simulation.sequence import make_setting
from jradar.simulation.sets import ROBUSTNESS, SETS, UNSEEN, set_sequences
from jradar.simulation.units import (
    FIRST_SHIFT,
    LATER_SHIFTS,
    SHIFTS,
    WAVEFORM_SHARES,
    WAVEFORMS,
    UnitSpec,
    draw_unit,
    shifted_unit,
)

RADAR = RadarSpec.awr1843()
FIRST = (401778, 0, True, 13.639520305235212, 5.417872029960084, 1.7381923674469104)
PLAIN = UnitSpec(calibration_degrees=0.0, range_bias_m=0.0, leakage_db=-400.0)


def test_no_board_of_the_robustness_set_is_drawn_for_training():
    drawn = [draw_unit(seed) for seed in range(300)]
    boards = {unit.board for unit in drawn}
    assert len(boards) > 297 and max(boards) < FIRST_SHIFT
    shifted = [shifted_unit(shift).board for shift in SHIFTS]
    assert all(board is None or board > FIRST_SHIFT for board in shifted)
    for test in (lambda u: u.speed_mps == 0, lambda u: u.calibration_degrees is None):
        assert 0.15 < np.mean([*map(test, drawn)]) < 0.4
    assert drawn[7] == draw_unit(7)


def test_training_sets_share_no_layout_with_the_robustness_set():
    tested = {item[1:3] for name in ROBUSTNESS for item in set_sequences(name)}
    for name in SETS:
        items = set_sequences(name)
        seen = {item[1:3] for item in items if item.split != "test"}
        assert not seen & tested and UNSEEN not in {family for family, _ in seen}
    units = [item.unit for item in set_sequences("jradar-sim-2")]
    assert len({*units}) == len(units)


def test_phases_of_boards_have_the_units_spread():
    unit = UnitSpec(channel_degrees=17.0, channel_db=1.0)
    units = (dataclasses.replace(unit, board=board) for board in range(300))
    boards = [make_unit_hardware(one, RADAR).phase for one in units]
    tx, rx = (np.array([b[k] for b in boards]) for k in ((2, 0), (0, 2)))
    for factor, share in ((tx, 1.0), (rx, 0.5)):  # relative to the first: two draws
        spread = np.degrees(np.angle(factor)).std() / 2**0.5
        assert spread == pytest.approx(17 * share, rel=0.1)
        level = (20 * np.log10(np.abs(factor))).std() / 2**0.5
        assert level == pytest.approx(share, rel=0.1)


def test_a_calibrated_unit_is_calibrated_up_to_the_error_of_its_file(tmp_path):
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    unit = dataclasses.replace(PLAIN, board=3, channel_degrees=40.0, mount_degrees=1.0)
    folder = simulate_sequence("corridor", 5, tmp_path, frames=1, unit=unit)
    recording = open_recording(folder)
    assert json.loads((folder / "unit.json").read_text())["board"] == 3
    assert not (tmp_path / "calib").exists()
    calibrated = calibrate(recording.cube(0), recording.radar)
    raw, cube = np.asarray(recording.cubes[0]), np.asarray(calibrated)
    factor = make_unit_hardware(unit, RADAR).phase
    ratio = (raw / cube)[..., 0, 40]
    np.testing.assert_allclose(ratio, factor, atol=1e-3)
    place = np.asarray(recording.base_from_radar)[:3, 3]
    np.testing.assert_allclose(place, described_mount("single_chip", unit)[0])


def test_a_mounted_rig_is_higher_tilted_and_slower():
    platform = make_setting("corridor", 5).scene.platform
    moved = mounted(platform, raised_m=0.4, tilt_rad=0.2)
    (xyz, turn), (high, down) = pose_at(platform, 3.0), pose_at(moved, 3.0)
    np.testing.assert_allclose(high - xyz, [0, 0, 0.4], atol=1e-9)
    ahead = np.arcsin(turn[2, 0]) - np.arcsin(down[2, 0])
    assert ahead == pytest.approx(0.2, abs=0.01)
    still = mounted(platform, speed_mps=0.0)
    np.testing.assert_array_equal(pose_at(still, 1.0)[0], pose_at(still, 9.0)[0])
    assert np.abs(velocity_at(still, 4.0)).max() == 0


def test_diffuse_echoes_have_the_asked_power_and_fall_with_range():
    view = Viewpoint(np.zeros(3), np.eye(3), np.array([1.0, 0, 0]))
    power = np.zeros(140)
    for seed in range(200):
        paths = diffuse_clutter(seed, view, RADAR, counts=7.7)
        distance = np.linalg.norm(paths.xyz, axis=-1)
        column = (distance / CELL_M).astype(int)
        power += np.bincount(column, LINK.counts(paths.power) ** 2, len(power))
    rms = np.sqrt(power / 200)
    assert rms[int(3 / CELL_M)] == pytest.approx(7.7, rel=0.15)
    near, far = rms[20:30].mean(), rms[80:120].mean()
    assert near / far == pytest.approx(100 / 25, rel=0.15)


def test_diffuse_echoes_stand_still_in_the_room():
    velocity = np.array([0.5, 0.2, 0.0])
    view = Viewpoint(np.ones(3), np.eye(3), velocity)
    paths = diffuse_clutter(1, view, RADAR, counts=1.0)
    towards = paths.xyz / np.linalg.norm(paths.xyz, axis=-1, keepdims=True)
    np.testing.assert_allclose(paths.velocity, -towards @ velocity, atol=1e-12)
    again = diffuse_clutter(1, view, RADAR, counts=1.0)
    np.testing.assert_array_equal(again.xyz, paths.xyz)
    apart = view._replace(xyz=view.xyz + [0.06, 0, 0])
    assert not np.allclose(diffuse_clutter(1, apart, RADAR, counts=1.0).xyz, paths.xyz)


def test_phase_drift_is_a_walk_of_the_asked_size():
    keys = jax.random.split(jax.random.key(0), 400)
    drift = jax.vmap(lambda key: phase_drift(key, jnp.float32(0.04), RADAR))(keys)
    drift = np.asarray(drift)
    assert np.sqrt((drift**2).mean()) == pytest.approx(0.04, rel=0.1)
    order = drift.transpose(0, 2, 1).reshape(len(keys), -1)  # tx fire in array order
    steps, whole = np.diff(order), order[:, -1] - order[:, 0]
    assert whole.var() == pytest.approx(steps.var() * steps.shape[1], rel=0.25)


def test_an_image_and_an_edge_have_their_levels():
    unit = dataclasses.replace(PLAIN, image_db=-36.0, edge_db=7.0, offset_counts=5.0)
    front_end = make_front_end(np.random.default_rng(0), unit, RADAR)
    time = np.arange(128) / 128
    tone = np.exp(2j * np.pi * 30 * time) + 0 * np.zeros(RADAR.cube_shape)
    end = np.exp(2j * np.pi * 127 * time)
    cube = jnp.asarray(1000 * (tone + end), jnp.complex64)
    seen = np.asarray(distort(jax.random.key(0), cube, front_end, RADAR))
    level = 20 * np.log10(np.abs(np.fft.fft(seen)[0, 0, 0] / 128 / 1000))
    assert level[30] == pytest.approx(0, abs=0.1)
    assert level[128 - 30] == pytest.approx(-36, abs=0.3)
    assert level[127] == pytest.approx(-7 * (127 / 128 - 0.75) ** 2 * 16, abs=0.1)
    assert level[0] == pytest.approx(20 * np.log10(5 / 1000), abs=0.1)


def sampled(paths, **changes):
    """A frame of a plain unit with some fields changed."""
    hardware = make_unit_hardware(dataclasses.replace(PLAIN, **changes), RADAR)
    return np.asarray(sample_frame(jax.random.key(0), paths, hardware, RADAR))


def test_noise_and_gain_are_in_decibels():
    none = Paths(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))

    def power(**changes):
        frame = sampled(none, **changes).astype(float)
        return 10 * np.log10((frame**2).mean() - 1 / 12)

    quiet = power(gain_db=12.0)
    assert power(gain_db=12.0, noise_db=6.0) - quiet == pytest.approx(6, abs=0.1)
    assert power(gain_db=18.0) - quiet == pytest.approx(6, abs=0.1)


def test_gain_clips_strong_echoes():
    strong = np.array([[2.0, 0, 0]])
    paths = Paths(strong, strong, np.zeros(1), np.array([1e-6]))  # mW: 580 counts
    assert np.abs(sampled(paths, gain_db=0.0).astype(int)).max() < 900
    frame = sampled(paths, gain_db=38.0)
    assert frame.dtype == np.int16 and (frame.max(), frame.min()) == (32767, -32768)
    assert 0.2 < np.mean(np.abs(frame.astype(int)) >= 32767) < 0.8


def second(count):
    return [draw_unit(seed, population=2) for seed in range(count)]


def test_the_second_population_is_wider_and_meets_no_shift():
    drawn = second(400)
    boards = {unit.board for unit in drawn}
    assert len(boards) > 396 and 0 < min(boards) and max(boards) < FIRST_SHIFT
    for name in ("speed_mps", "height_m", "clutter_counts", "noise_db"):
        shifts = {getattr(shifted_unit(shift), name) for shift in SHIFTS} - {None, 0.0}
        assert not shifts & {getattr(unit, name) for unit in drawn}
    later = {shifted_unit(shift).waveform for shift in LATER_SHIFTS}
    assert later - {None} and not later & {unit.waveform for unit in drawn}
    clutter = np.array([unit.clutter_counts for unit in drawn])
    assert 0.8 < np.mean(clutter > 0) < 0.9 and 7.7 < clutter.max() <= 10
    speed = np.array([unit.speed_mps for unit in drawn if unit.speed_mps])
    assert np.mean(speed > 2) == pytest.approx(0.5, abs=0.1) and speed.max() < 3.2
    wild = [u.channel_degrees for u in drawn if u.calibration_degrees is None]
    assert max(wild) > 34 and 0.2 < len(wild) / len(drawn) < 0.4
    assert 0.05 < np.mean([unit.gain_db > 22 for unit in drawn]) < 0.2
    shares = {"floor_bounces": 0.7, "wall_echoes": 0.5, "wind_mph": 0.7}
    for name, share in shares.items():
        found = np.mean([bool(getattr(unit, name)) for unit in drawn])
        assert found == pytest.approx(share, abs=0.08)


def test_waveforms_have_one_array_and_bins_of_four_to_twelve_centimetres():
    radars = {name: UnitSpec(waveform=name).radar() for name in WAVEFORMS}
    assert sum(WAVEFORM_SHARES) == pytest.approx(1)
    assert radars.pop("coloradar") == RADAR
    shifted = {shifted_unit(shift).radar() for shift in SHIFTS}
    for radar in radars.values():
        assert radar.tx_positions == RADAR.tx_positions and radar not in shifted
        assert 0.04 < radar.range_resolution_m < 0.126 and 9 < radar.max_range_m < 16
        assert 64 <= radar.num_chirps <= 255
        assert radar.num_chirps * radar.turn_period_s < 0.1  # ten frames a second
    names = [unit.waveform for unit in second(300)]
    assert set(names) == set(WAVEFORMS)
    with pytest.raises(ValueError, match="waveform 'chirpy', expected one of color"):
        UnitSpec(waveform="chirpy").radar()
    with pytest.raises(UsageError, match="'cascade', expected one of single_chip"):
        make_setting("lab", 0, sensor="cascade", unit=UnitSpec())


def test_files_of_earlier_sets_name_no_later_fields():
    written = draw_unit(3).written()
    assert [*written][-1] == "one_row" and "waveform" not in written
    later = UnitSpec(waveform="96-chirps", wind_mph=3.0).written()
    assert [*later][-2:] == ["waveform", "wind_mph"]
    with pytest.raises(ValueError, match="population=3, expected one of"):
        draw_unit(3, population=3)


def test_the_first_population_stays_as_it_was():
    unit = draw_unit(12345)
    assert (unit.board, unit.interferers, unit.coupling_file) == FIRST[:3]
    values = (unit.channel_degrees, unit.clutter_counts, unit.height_m)
    assert values == pytest.approx(FIRST[3:], rel=1e-12)
