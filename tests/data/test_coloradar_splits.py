"""ColoRadar's sequences and the paper's split."""

import pytest

from jradar.data.sources import SEQUENCES, scene, usual_split


def test_there_are_52_sequences_and_21_train():
    assert len(SEQUENCES) == 52
    scenes = [where for where, _ in SEQUENCES.values()]
    expected = {"Arpg Lab": 5, "Hallways": 5, "Aspen Lab": 12, "Longboard": 8}
    expected |= {"Outdoor": 10, "Edgar Mine": 12}
    assert {where: scenes.count(where) for where in scenes} == expected
    assert [split for _, split in SEQUENCES.values()].count("train") == 21


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
    assert (usual_split(name), scene(name)) == (split, where)


@pytest.mark.parametrize(
    "name", ["ec_hallways_run5", "1_1_2020_aspen_run0", "run0", "", "aspen_run01"]
)
def test_names_of_no_sequence_are_refused(name):
    with pytest.raises(ValueError, match="is not a sequence of ColoRadar, expected"):
        scene(name)
    assert usual_split(name) == "train"
