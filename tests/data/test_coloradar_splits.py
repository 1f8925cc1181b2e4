"""ColoRadar's sequences and the paper's split."""

import pytest

from jradar.data import SEQUENCES, scene
from jradar.data.sources import paper_split


def test_there_are_52_sequences_and_21_train():
    names = [name for names in SEQUENCES.values() for name in names]
    assert len(names) == len(set(names)) == 52
    counts = {place: len(names) for place, names in SEQUENCES.items()}
    assert counts == {
        "arpg_lab": 5,
        "ec_hallways": 5,
        "aspen": 12,
        "longboard": 8,
        "outdoors": 10,
        "edgar_army": 6,
        "edgar_classroom": 6,
    }
    assert SEQUENCES["aspen"][-2:] == ("2_24_2021_aspen_run10", "2_24_2021_aspen_run11")
    assert [paper_split(name) for name in names].count("train") == 21


@pytest.mark.parametrize(
    ("name", "split", "where"),
    [
        ("12_21_2020_ec_hallways_run2", "train", "Hallways"),
        ("ec_hallways_run3", "test", "Hallways"),
        ("aspen_run10", "test", "Aspen Lab"),
        ("edgar_army_run0", "train", "Edgar Mine"),
        ("2_23_2021_edgar_classroom_run5", "test", "Edgar Mine"),
        ("2_28_2021_outdoors_run9", "test", "Outdoor"),
        ("arpg_lab_run4", "test", "Arpg Lab"),
        ("longboard_run7", "test", "Longboard"),
    ],
)
def test_split_and_scene_of_a_name(name, split, where):
    assert (paper_split(name), scene(name)) == (split, where)


@pytest.mark.parametrize(
    "name", ["ec_hallways_run5", "1_1_2020_aspen_run0", "run0", "", "aspen_run01"]
)
def test_names_of_no_sequence_are_refused(name):
    with pytest.raises(
        ValueError, match="is not a sequence of ColoRadar, expected a name"
    ):
        paper_split(name)
