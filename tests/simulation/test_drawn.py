"""Frames of places of their own: splits, calibration, the same frame again."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jradar.errors import UsageError
from jradar.lidar import interpolate_poses, transform
from jradar.model.grids.polar import RADARHD
from jradar.recordings import nearest_scan
from jradar.recordings.coloradar.calib import read_coupling, read_frequency_phase
from jradar.simulation import drawn, drawn_sources
from jradar.simulation.coloradar_writer import write_calib
from jradar.simulation.drawn import kind_of, row_sources
from jradar.simulation.hardware.hardware import make_unit_hardware
from jradar.simulation.units import draw_unit

pytest.importorskip("embreex", reason="the extra `sim` is not installed")


def test_splits_share_neither_layouts_nor_runs(tmp_path):
    for kind in drawn.ENVIRONMENTS:
        for run in range(12):
            (tmp_path / f"{kind}_run{run}.npz").touch()
    sources = drawn_sources("jradar-sim-5", maps=tmp_path)
    frames, runs = {}, {}
    for source in sources:
        assert kind_of(source.name) == source.kind
        frames.setdefault(source.split, set()).add((source.kind, source.number))
        runs.setdefault(source.split, set()).add(source.path)
    names = [source.name for source in sources]
    assert len(set(names)) == len(names)
    assert drawn.FRAMES * len(frames["train"]) > 20_000
    for a, b in (("train", "validation"), ("train", "test"), ("validation", "test")):
        assert not frames[a] & frames[b]
        assert not (runs[a] & runs[b]) - {""}
    assert not any("_run0." in path for paths in runs.values() for path in paths)


def test_sets_and_maps_that_are_missing_are_named(tmp_path):
    with pytest.raises(UsageError, match="expected one of jradar-sim-5"):
        drawn_sources("jradar-sim-7")
    with pytest.raises(FileNotFoundError, match="no arpg_lab_runN"):
        drawn_sources("jradar-sim-5", maps=tmp_path)
    kinds = {source.kind for source in drawn_sources("jradar-sim-5-mini")}
    assert kinds == {*drawn.NEWER, *drawn.OLDER}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_radar_is_the_one_that_calibration_files_would_describe(seed, tmp_path):
    unit = draw_unit(seed)
    radar = unit.radar()
    hardware = make_unit_hardware(unit, radar)
    found = drawn.described(radar, hardware)
    write_calib(tmp_path / "calib", {"single_chip": (radar, hardware)})
    folder = tmp_path / "calib" / "single_chip"
    leakage = read_coupling(folder / "coupling_calib.txt")
    np.testing.assert_allclose(found.leakage, leakage, rtol=1e-4, atol=0.1)
    path = folder / "phase_frequency_calib.txt"
    assert path.exists() == (found.channels is not None)
    if found.channels is not None:
        channels, beats = read_frequency_phase(path, radar)
        np.testing.assert_allclose(found.channels, channels, rtol=1e-5)
        np.testing.assert_allclose(found.beat_bins, beats, atol=1e-6)


def test_a_frame_is_the_same_whenever_it_is_drawn():
    source = drawn_sources("jradar-sim-5-mini")[3]
    first, other = source.open().lidar[5], source.open().lidar[6]
    drawn._setting.cache_clear()
    drawn._scene.cache_clear()
    np.testing.assert_array_equal(source.open().lidar[5], first)
    assert np.abs(first - other).max() > 1
    ahead = np.linalg.norm(first[:, :3], axis=1) > 0
    assert 15_000 < len(first) < 65_536 and ahead.mean() > 0.3


def test_the_frames_of_a_walk_show_one_place_along_its_poses():
    sources = drawn_sources("jradar-sim-6-mini")
    moving = (s for s in sources if (drawn._unit(s.name, False).speed_mps or 0) > 0.5)
    walk = next(moving).open()
    assert len(walk.cubes) == drawn.WALK_FRAMES and len(walk.poses.stamps) == 14
    poses = interpolate_poses(walk.poses, walk.cubes.stamps) @ walk.base_from_radar
    first, later = (nearest_scan(walk, k)[:, :3] for k in (0, 2))
    first, later = (xyz[np.linalg.norm(xyz, axis=1) > 0] for xyz in (first, later))
    moved = transform(np.linalg.inv(poses[2]) @ poses[0], first)
    near = cKDTree(later).query(moved)[0]
    still = cKDTree(later).query(first)[0]
    assert np.median(near) < 0.6 * np.median(still)
    assert not np.array_equal(walk.cube(0), walk.cube(1))


def test_each_frame_of_a_walk_has_noise_of_its_own():
    setting = drawn._setting(drawn_sources("jradar-sim-6-mini")[0], 0)
    seen = drawn.TIME_S + np.array([0.0, 1e-9])  # nothing moves in between
    first, later = (drawn._cube(setting, seen, k) for k in (0, 1))
    assert np.std(later - first) > 1e-4 * np.std(first)
    np.testing.assert_array_equal(drawn._cube(setting, seen, 0), first)


def test_a_walk_through_a_map_is_no_faster_than_its_path_is_free(monkeypatch):
    source = drawn_sources("jradar-sim-6-mini")[0]._replace(path="map")
    scene = drawn._scene(source._replace(path=""), 0)
    monkeypatch.setattr(drawn, "_scene", lambda source, frame: scene)
    monkeypatch.setattr(drawn, "_seen_share", lambda scene, yaw: 1.0)
    carried = []
    monkeypatch.setattr(
        drawn, "carried", lambda s, seed, unit, **_: carried.append(unit) or setting
    )
    setting = drawn._setting(source._replace(path=""), 0)
    for number in range(40):
        drawn._setting(source._replace(name=f"walk_{number}"), 0)
    speeds = [unit.speed_mps for unit in carried[1:]]
    assert max(speeds) == drawn.WALK_MPS and min(speeds) == 0


def test_walks_and_single_frames_share_no_place():
    walks = drawn_sources("jradar-sim-6")
    singles = {(s.kind, s.number) for s in drawn_sources("jradar-sim-5")}
    assert not singles & {(s.kind, s.number) for s in walks}
    assert {s.kind for s in walks} == {*drawn.NEWER, *drawn.OLDER}


def test_sources_of_one_row_have_radarhds_chirp_and_layouts_that_train():
    sources = row_sources()
    trained = {(s.kind, s.number) for s in drawn_sources("jradar-sim-5")}
    assert {(s.kind, s.number) for s in sources} < trained
    assert {s.split for s in sources} == {"train"}
    recording = sources[-1].open()
    chirp = ("slope_hz_per_s", "sample_rate_hz", "num_samples", "num_chirps")
    for name in (*chirp, "virtual_positions"):
        found = getattr(recording.radar.spec, name)
        np.testing.assert_array_equal(found, getattr(RADARHD, name))
    samples = recording.cube(0)
    assert samples.shape == (2, 4, 64, 512) and np.abs(samples).max() > 10
    azimuth = np.arctan2(*nearest_scan(recording, 0)[:, 1::-1].T)
    assert np.degrees(np.abs(azimuth)).max() > 80


def test_the_lowest_full_level_is_the_floor():
    heights = np.r_[np.full(90, -1.4), np.full(20, 0.1), np.full(100, 1.6), -3.0]
    assert drawn.floor_height(heights) == pytest.approx(-1.4, abs=0.08)
