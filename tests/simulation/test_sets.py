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


def test_layouts_to_test_on_are_in_no_other_split_and_have_units_of_their_own():
    items = set_sequences("jradar-sim-4-test")
    tested = {item[1:3] for item in items if item.split == "test"}
    others = set_sequences("jradar-sim-1")
    others = {item[1:3] for item in others if item.split != "test"}
    assert len(tested) == 6 * 192 and not tested & others
    units = {item.unit for item in items}
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


def test_an_unknown_set_is_refused_with_the_known_ones():
    with pytest.raises(UsageError, match=r"'jradar-sim', expected .*-robust/SHIFT"):
        set_sequences("jradar-sim")
