"""Raw samples in ROS bags: the messages of xwr_ros and of iwr_raw_rosnode."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")

from jradar.errors import UsageError  # noqa: E402
from jradar.recordings import is_recording, open_recording  # noqa: E402
from tests.recordings.bag_writer import (  # noqa: E402
    ARRAY,
    FRAME,
    IMU,
    IQ,
    START,
    TENTH,
    imu,
    livox_bag,
    livox_rows,
    raw_samples,
    write_bag,
)
from tests.recordings.dca1000_writer import CFG, as_bytes, random_cubes  # noqa: E402

CUBES = random_cubes(3)
WORDS = [np.frombuffer(as_bytes([cube]), "<i2") for cube in CUBES]


def write(folder, kind=IQ, container="bag", topics=("/radar",), words=WORDS):
    """A bag whose messages were recorded 20 ms after their stamps."""
    (folder / "profile.cfg").write_text(CFG)
    messages = [
        (topic, kind, stamp + TENTH // 5, raw_samples(kind, frame, stamp))
        for topic in topics
        for frame, stamp in zip(words, range(START, 2 * START, TENTH), strict=False)
    ]
    return write_bag(folder, container, messages)


@pytest.mark.parametrize("container", ["bag", "sqlite"])
@pytest.mark.parametrize("kind", [IQ, FRAME, ARRAY])
def test_frames_and_their_times_come_back(tmp_path, kind, container):
    recording = open_recording(write(tmp_path, kind, container))
    np.testing.assert_array_equal([*recording.cubes], CUBES)
    late = 0.0 if kind == IQ else 0.02
    expected = 1.7e9 + late + 0.1 * np.arange(3)
    np.testing.assert_allclose(recording.cubes.stamps, expected, atol=1e-6)
    assert any("on the topic /radar" in note for note in recording.notes)


def test_another_order_of_i_and_q_is_taken(tmp_path):
    words = [np.frombuffer(as_bytes([cube], "QQII"), "<i2") for cube in CUBES]
    recording = open_recording(write(tmp_path, words=words), iq_order="QQII")
    np.testing.assert_array_equal([*recording.cubes], CUBES)


def test_an_imu_in_the_bag_is_read_and_a_damaged_one_left_out(tmp_path):
    (tmp_path / "profile.cfg").write_text(CFG)
    record = np.array([0, 0, -9.81, 0.1, 0.2, 0.3])
    frame = ("/radar", IQ, START, raw_samples(IQ, WORDS[0], START))
    for number, numbers, known in ((0, record, True), (1, record * np.nan, False)):
        places = range(START, START + 5 * TENTH, TENTH)
        inertial = [("/imu", IMU, stamp, imu(numbers, stamp)) for stamp in places]
        (tmp_path / str(number)).mkdir()
        path = write_bag(tmp_path / str(number), "sqlite", [frame, *inertial])
        found = open_recording(path, tmp_path / "profile.cfg")
        if known:
            np.testing.assert_allclose(found.imu.force, np.tile(record[:3], (5, 1)))
        else:
            assert found.imu is None and "IMU is left out" in found.notes[-1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"words": [WORDS[0][:-2]]}, r"holds 1,198 numbers, .* needs 1,200"),
        ({"topics": ("/left", "/right")}, "2 topics of raw samples, name one of /left"),
    ],
    ids=["size", "topics"],
)
def test_other_samples_are_refused(tmp_path, change, message):
    path = write(tmp_path, **change)
    with pytest.raises((ValueError, UsageError), match=message):
        open_recording(path)


def test_bags_of_clouds_are_no_recordings_of_a_radar(tmp_path):
    assert not is_recording(livox_bag(tmp_path, "mcap", [livox_rows(2)]))
    (tmp_path / "empty.bag").write_bytes(b"")
    assert not is_recording(tmp_path / "empty.bag")
