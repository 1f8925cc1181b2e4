"""A set of places: prepared without recordings, resumed, and without one kind."""

import numpy as np
import pytest

from experiments import build, places
from experiments.configs import smoke
from experiments.radarhd.pairs import open_radarhd
from jradar import data
from jradar.errors import UsageError
from jradar.radar import radar_points
from jradar.simulation import drawn

pytest.importorskip("embreex", reason="the extra `sim` is not installed")


@pytest.mark.slow
def test_a_kind_is_left_out_and_alone_is_tested(tmp_path, monkeypatch):
    monkeypatch.setattr(drawn, "FRAMES", 1)
    monkeypatch.setattr(drawn, "NEWER", ("open", "stairwell"))
    monkeypatch.setattr(drawn, "OLDER", ())
    unit = drawn.draw_unit(0)  # one waveform: compiled once
    monkeypatch.setattr(drawn, "draw_unit", lambda seed: unit)
    config = smoke.get_config()
    config.data.set = "jradar-sim-5-mini"
    folder = build.prepared_data(config, tmp_path)
    frames = [*data.Records(folder, "train")]
    assert [frame.sequence for frame in frames] == ["open_00000", "stairwell_00000"]
    assert all(frame.radar.valid.any() for frame in frames)
    assert len(frames[1].lidar_xyz) > 1000
    config.data.without = "open"
    for split, expected in {
        "train": "stairwell_00000",
        "validation": "stairwell_50000",
        "test": "open_60000",
    }.items():
        records = build.records_of(config, folder, split)
        assert [name for name, _ in records.where] == [expected]
    config.data.without = "opera"
    with pytest.raises(UsageError, match=r"'opera', expected one of \['open', 'stair"):
        build.records_of(config, folder, "train")


def test_polar_pairs_are_written_once(tmp_path, monkeypatch):
    monkeypatch.setattr(drawn, "FRAMES", 2)
    source = drawn.row_sources()[-1]
    places.write_polar_pairs([source], tmp_path)
    pairs = open_radarhd(tmp_path)
    assert pairs.keys.tolist() == [[0, 0], [0, 1]]
    (first, second), recording = pairs, source.open()
    for pair in (first, second):
        assert pair.radar.max() > 200 and 20 < pair.lidar.sum() < 5000
    points = radar_points(recording.cube(1), recording.radar)
    heard = np.asarray(points.xyz)[np.asarray(points.valid)]
    np.testing.assert_array_equal(second.points, heard)
    assert len(heard) > 50
    lit = tmp_path / "train" / "radar" / "R_0_1.png"
    lit.unlink()
    places.write_polar_pairs([source], tmp_path)
    assert not lit.exists()  # the source was complete
    others = tmp_path / "train"  # a folder that the command did not begin
    with pytest.raises(UsageError, match="train holds other files, expected an empty"):
        places.write_polar_pairs([source], others)
