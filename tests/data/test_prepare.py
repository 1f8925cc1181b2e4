"""Preparation: the same bytes however it is run; dropped frames are counted."""

import re
import shutil

import numpy as np
import pytest

from jradar.data.prepare import prepare
from jradar.data.records import Records
from jradar.data.sources import find_sources
from jradar.data.spec import PrepareSpec
from jradar.errors import UsageError
from jradar.radar import PointSpec
from jradar.recordings import open_recording
from tests.data.prepared import SPEC, digests, with_points
from tests.recordings.small_sequence import SIDE, write_sequence, write_splits


def test_records_hold_both_sensors(prepared):
    records = Records(prepared, "train")
    assert records.where == [("12_21_2020_ec_hallways_run0", i) for i in range(5)]
    assert [s["split"] for s in Records(prepared).sequences] == ["train", "test"]
    frame = records[2]
    assert frame.stamp == pytest.approx(1000.2) and frame.cells.power.shape == (16, 64)
    assert frame.lidar_stamp == pytest.approx(1000.21)
    np.testing.assert_allclose(frame.world_from_radar[:3, 3], [0.1, 0, 0], atol=1e-6)
    points = frame.radar.xyz[frame.radar.valid]
    assert len(points) == 128  # the near-zero threshold fills the capacity
    truth = frame.lidar_xyz  # moved by the platform's 5 mm between the stamps
    ahead = truth[np.abs(truth[:, 1]) < 2]
    assert len(ahead) > 100 and np.abs(truth[:, 2]).max() < 1.17  # floor, ceiling gone
    assert np.quantile(ahead[:, 0], 0.9) == pytest.approx(SIDE + 0.005, abs=0.03)


def test_music_in_a_range_of_frames_does_not_change_the_truth(root, prepared, tmp_path):
    spec = with_points(SPEC, angles="music")
    prepare(root, tmp_path, spec, frames=slice(1, 2), workers=1)
    assert [frame for _, frame in Records(tmp_path).where] == [1, 1]
    plain, music = Records(prepared)[1], Records(tmp_path)[0]
    np.testing.assert_array_equal(music.cells.power, plain.cells.power)
    np.testing.assert_array_equal(music.lidar_xyz, plain.lidar_xyz)
    strong = plain.cells.power > 100 * np.median(plain.cells.power)
    apart = abs(music.cells.azimuth - plain.cells.azimuth)[strong]
    assert 0 < np.median(apart) < 0.1


def test_points_come_from_the_options_in_a_file(tmp_path):
    spec = with_points(SPEC, detector="ca", angles="music")
    shared = {"capacity": 128, "train": (2, 4), "detector": "ca"}
    assert spec.visible_points == PointSpec(false_alarm_rate=1e-3, **shared)
    text = "block = 2\n[points]\ncapacity = 128\ntrain = [2, 4]\n"
    (tmp_path / "spec.toml").write_text(text + "[lidar]\nmax_range_m = 7\n")
    assert PrepareSpec.from_toml(tmp_path / "spec.toml") == SPEC


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("[points]\ncapacty = 1", "spec.toml: unknown field 'capacty', expected capac"),
        ("[points]\ncapacity = 'many'", "capacity = 'many', expected an integer"),
        ("[points]\ncapacity = true", "capacity = True"),
        ("[points]\nrefine = 1", "refine = 1, expected true or false"),
        ("[points]\nguard = [1]", r"guard = \[1\], expected a list of 2 integers"),
        ("[points]\nguard = [1.5, 2]", r"guard = \[1.5, 2\]"),
        ("[points]\nguard = 2", "guard = 2, expected a list of 2 integers"),
        ("[points]\ndetector = ['os']", "expected a text"),
        ("[points]\nfalse_alarm_rate = 'low'", "expected a number"),
        ("[points]\nfalse_alarm_rate = 2", "false_alarm_rate = 2.0, expected 0 < rate"),
        ("visible_false_alarm_rate = 0", "visible_false_alarm_rate = 0"),
        ("block = 0", "block = 0, expected 1 or more"),
        ("tolerance_s = -1", "tolerance_s = -1.0, expected 0 or more"),
        ("tolerance_s = nan", "tolerance_s = nan, expected a number"),
        ("lidar = 3", "lidar = 3, expected a table"),
        ("[lidar]\nsensor_height_m = 'low'", "sensor_height_m = 'low', expected"),
        ("[lidar]\nsensor_height_m = true", "height_m = True, expected a number"),
        ("[lidar]\nazimuth = [0.1]", "azimuth = .0.1., expected a list of 2 number"),
        ("[lidar]\nmin_points = 2.5", "min_points = 2.5, expected an integer"),
        ("[lidar]\nmax_range_m = -1", "max_range_m = -1.0: expected"),
        ("capacity =", "spec.toml is damaged or not a TOML file"),
    ],
)
def test_wrong_options_in_a_file_are_usage_errors(tmp_path, text, match):
    path = tmp_path / "spec.toml"
    path.write_text(text)
    with pytest.raises(UsageError, match=match):
        PrepareSpec.from_toml(path)


def test_a_folder_of_captures_is_several_sources(tmp_path):
    for name in ("walk", "stairs", ".walk-x1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "capture.toml").touch()
    assert [s.name for s in find_sources(tmp_path)] == ["stairs", "walk"]


def test_a_folder_of_files_is_several_sources_and_a_damaged_one_is_among_them(tmp_path):
    (tmp_path / "rig").mkdir()
    text = "frame,x,y,z,doppler\n0,5,1,0,1\n1,5,1,0,1\n"
    for name in ("a.csv", "rig/b.csv"):
        (tmp_path / name).write_text(text)
    (tmp_path / "broken.csv").write_text("")
    (tmp_path / "notes.md").write_text("two walks")
    assert [s.name for s in find_sources(tmp_path)] == ["a", "broken", "b"]


def test_a_file_of_splits_overrides_the_paper(tmp_path):
    for name in ("a", "b", ".a-x1/a"):  # the last was left by a killed run
        (tmp_path / name / "single_chip/adc_samples/data").mkdir(parents=True)
    write_splits(tmp_path, {"b": "validation"})
    assert [s.split for s in find_sources(tmp_path)] == ["train", "validation"]
    write_splits(tmp_path, {"b": "exam"})
    with pytest.raises(ValueError, match='b is in "exam", expected one of'):
        find_sources(tmp_path)


def test_splits_by_name_override_all_others(tmp_path):
    write_sequence(tmp_path, "a", frames=1)
    write_sequence(tmp_path, "b", frames=1)
    write_splits(tmp_path, {"b": "validation"})
    found = find_sources(tmp_path, splits={"a": "test", "b": "train"})
    assert [s.split for s in found] == ["test", "train"]
    assert find_sources([tmp_path / "b", tmp_path / "a"])[0].name == "b"
    with pytest.raises(UsageError, match="no sequence 'c' to put into test: "):
        find_sources(tmp_path, splits={"c": "test"})
    with pytest.raises(UsageError, match="validation_share=1, expected 0 to less"):
        find_sources(tmp_path, validation_share=1)


@pytest.mark.parametrize("times", [True, False])
def test_the_end_of_a_recording_validates_apart_from_its_beginning(tmp_path, times):
    write_sequence(tmp_path, "a", frames=1)
    first, last = find_sources(tmp_path, validation_share=0.25)
    assert (first.split, last.split) == ("train", "validation")
    assert (first.name, last.name) == ("a", "a-end")

    class Walk:
        def __init__(self):
            self.frames, self.stamps = self, np.arange(400) * 0.05 if times else None

        def __len__(self):
            return 400

    # 2 s, or 20 frames, lie between the two.
    gap = 40 if times else 20
    walk = Walk()
    assert first.frames(walk, slice(None)) == range(300 - gap)
    assert last.frames(walk, slice(None)) == range(300, 400)
    assert last.frames(walk, slice(0, 200)) == range(150, 200)
    if times:  # of a radar that was started again
        walk.stamps[220:] -= 8
        assert first.frames(walk, slice(None)) == range(300 - gap)


def test_a_second_run_writes_missing_shards_and_keeps_others(root, prepared, tmp_path):
    folder = tmp_path / "copy"
    shutil.copytree(prepared, folder)
    torn, lost, *_, kept = sorted(folder.rglob("*.array_record"))
    lost.unlink()
    torn.write_bytes(torn.read_bytes()[:-100])
    mine = folder / "12_21_2020_ec_hallways_run0" / ".my-notes" / "thesis.txt"
    mine.parent.mkdir()
    mine.write_text("years of work")
    before = kept.stat().st_mtime_ns
    prepare(root, folder, SPEC, workers=1)
    assert digests(folder) == digests(prepared)
    Records(folder).verify()
    assert kept.stat().st_mtime_ns == before
    assert mine.read_text() == "years of work"


def test_other_options_are_refused(root, prepared):
    other = with_points(SPEC, capacity=64)
    with pytest.raises(UsageError, match="other options: capacity was 128, now 64"):
        prepare(root, prepared, other, workers=1)
    with pytest.raises(UsageError, match="other frames"):
        prepare(root, prepared, SPEC, workers=1, frames=slice(0, 2))
    sequence = find_sources(root)[0].path
    with pytest.raises(UsageError, match=r"other names: \d removed \['.*0 added"):
        prepare(sequence, prepared, SPEC, workers=1)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("thesis.tex", "do not touch"),
        ("manifest.json", '{"name": "my page"}'),
        ("manifest.json", '{"set": "jradar-sim-1"}'),
    ],
)
def test_a_folder_of_something_else_is_left_alone(root, tmp_path, name, content):
    (tmp_path / name).write_text(content)
    with pytest.raises(UsageError, match="neither empty nor a folder of records"):
        prepare(root, tmp_path, SPEC, workers=1)
    assert (tmp_path / name).read_text() == content


@pytest.mark.slow
def test_two_workers_write_the_same_bytes(root, prepared, tmp_path):
    prepare(root, tmp_path, SPEC, workers=2)
    assert digests(tmp_path) == digests(prepared)


def test_a_dask_scheduler_writes_the_same_bytes(root, prepared, tmp_path):
    from distributed import LocalCluster

    # The workers are threads: they import nothing again.
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False}
    place = {"protocol": "tcp", "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(**options, **place) as cluster:
        prepare(root, tmp_path, SPEC, scheduler=cluster.scheduler_address)
    assert digests(tmp_path) == digests(prepared)


def own_calib(root, name, file, pattern, text):
    """Give a sequence a `calib` of its own, with another line in a file of it."""
    calib = root / name / "calib"
    shutil.copytree(root / "calib", calib)
    path = calib / "single_chip" / file
    changed, count = re.subn(pattern, text, path.read_text())
    assert count == 1
    path.write_text(changed)


def test_sequences_with_other_chirps_are_processed_with_their_own(tmp_path):
    root, names = tmp_path / "in", [f"12_21_2020_ec_hallways_run{k}" for k in (0, 1, 2)]
    for name in names:
        write_sequence(root, name, frames=1)
    radar = open_recording(root / names[0]).radar.spec
    steep = radar.slope_hz_per_s * 1.25
    line = ("frequency_slope .*", f"frequency_slope {steep}")
    own_calib(root, names[1], "waveform_cfg.txt", *line)
    manifest = prepare(root, tmp_path / "out", SPEC, workers=1)
    assert manifest["radar"]["slope_hz_per_s"] == radar.slope_hz_per_s
    assert [entry["sequences"] for entry in manifest["other_radars"]] == [[names[1]]]
    records = Records(tmp_path / "out", "train")
    slopes = [records.radar_of(name).slope_hz_per_s for name in names]
    expected = [radar.slope_hz_per_s, steep, radar.slope_hz_per_s]
    assert slopes == pytest.approx(expected)
    assert records.other_radars == (records.radar_of(names[1]),)
    # The samples are the same: ranges shrink by the slope.
    usual, own = (records[records.where.index((name, 0))] for name in names[:2])
    np.testing.assert_allclose(own.cells.power, usual.cells.power)
    ranges = [np.linalg.norm(f.radar.xyz, axis=-1) for f in (usual, own)]
    np.testing.assert_allclose(ranges[1], ranges[0] / 1.25, rtol=1e-4, atol=1e-3)
    shutil.rmtree(root / names[1] / "calib")
    with pytest.raises(UsageError, match="prepared with other other_radars: 1 were"):
        prepare(root, tmp_path / "out", SPEC, workers=1)


def test_other_antennas_need_a_folder_of_their_own(tmp_path):
    root = tmp_path / "in"
    for name in ("lab_0", "lab_1"):
        write_sequence(root, name, frames=1)
    own_calib(root, "lab_1", "antenna_cfg.txt", "rx 3 3 0", "rx 3 5 0")
    with pytest.raises(ValueError, match="2 radars .* whose antennas differ"):
        prepare(root, tmp_path / "out", SPEC, workers=1)
    assert not (tmp_path / "out" / "manifest.json").exists()
