"""Data sets: splits without common layouts, digests, resuming."""

import json

import pytest

from jradar.errors import UsageError
from jradar.simulation import set_sequences, sets, simulate_set
from jradar.simulation.sets import Sequence


def test_splits_share_no_layout():
    scenes = [item[1:3] for item in set_sequences("jradar-sim-1")]
    assert len(set(scenes)) == len(scenes) == 6 * (384 + 4 + 4)
    splits = {item.split for item in set_sequences("jradar-sim-1")}
    assert splits == {"train", "validation", "test"}


@pytest.mark.parametrize("name", ["jradar-sim-1", "jradar-sim-4"])
def test_layouts_to_test_on_are_in_no_other_split(name):
    items = set_sequences(f"{name}-test")
    tested = {item[1:3] for item in items if item.split == "test"}
    items = set_sequences(name)
    others = {item[1:3] for item in items if item.split != "test"}
    assert len(tested) == 6 * 192 and not tested & others


def test_units_to_test_on_differ_and_have_the_same_chirps():
    units = {item.unit for item in set_sequences("jradar-sim-4-test")}
    assert len(units) == 6 * (16 + 192)
    assert len({unit.radar() for unit in units}) == 1


def test_a_set_keeps_what_matches_its_manifest(scene_built_once, tmp_path, monkeypatch):
    tiny = [Sequence("train", "corridor", 5), Sequence("test", "corridor", 6)]
    monkeypatch.setattr(sets, "set_sequences", lambda name: tiny)
    path = simulate_set("tiny", tmp_path, frames=1)
    manifest = json.loads(path.read_text())
    assert manifest["set"] == "tiny"
    assert manifest["sequences"]["corridor_6"]["split"] == "test"
    splits = json.loads((tmp_path / "splits.json").read_text())
    assert splits == {"corridor_5": "train", "corridor_6": "test"}
    stamps = "lidar/timestamps.txt"
    kept, changed = (tmp_path / f"corridor_{seed}" / stamps for seed in (5, 6))
    before, text = kept.stat().st_mtime_ns, changed.read_text()
    changed.write_text("0\n")
    simulate_set("tiny", tmp_path, frames=1)
    assert kept.stat().st_mtime_ns == before and changed.read_text() == text
    assert json.loads(path.read_text()) == manifest
    with pytest.raises(UsageError, match="another folder"):
        simulate_set("tiny", tmp_path, frames=2)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        *((name, "years of work") for name in ("splits.json", "lab_0", "thesis.tex")),
        ("manifest.json", '{"sequences": {"lab_0": {}}}'),
        ("manifest.json", '{"sequences": 3}'),
        ("manifest.json", '{"name": "my page"}'),
    ],
)
def test_a_folder_with_own_data_is_left_alone(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    message = f"holds {name} but no manifest of a set|not the manifest of a simulated"
    with pytest.raises(ValueError, match=message):
        simulate_set("jradar-sim-1-mini", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == text


def test_later_shifts_have_a_set_of_their_own_with_the_same_layouts():
    assert sets.robust_set("clean") == "jradar-sim-2-robust/clean"
    later = set_sequences("jradar-sim-4-robust/ti-indoor-waveform")
    before = set_sequences("jradar-sim-2-robust/clean")
    assert [item[:3] for item in later] == [item[:3] for item in before]
    (radar,) = {item.unit.radar() for item in later if item.unit}
    assert radar.num_chirps == 16 and 0.04 < radar.range_resolution_m < 0.05
    for name, message in (
        ("jradar-sim-4-robust/clean", "jradar-sim-4-robust/SHIFT with a shift of"),
        ("jradar-sim", "'jradar-sim', expected one of jradar-sim-1,"),
    ):
        with pytest.raises(UsageError, match=message):
            set_sequences(name)
