"""`open_recording`: the format of a path, its description, its options, its errors."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import is_recording, open_recording, read_description
from jradar.recordings.open import READERS
from jradar.recordings.recording import Format
from tests.recordings.cube_writer import LOG, SHAPE, random_cube, save, save_studio


def test_frames_of_one_chirp_serve_as_slow_time(tmp_path):
    log = LOG.replace("FrameConfig,0,1,3,4,", "FrameConfig,0,0,5,1,")
    many = random_cube((5, 1, 4, 1, 8))
    path = save_studio(tmp_path, many, log)
    merged = open_recording(path, frames_as_chirps=True)
    assert len(merged.cubes) == 1
    assert "5 frames were taken as chirps" in merged.notes[-1]
    slow_time = many[:, :, :, 0].transpose(1, 2, 0, 3)
    np.testing.assert_array_equal(merged.cubes[0], slow_time)
    assert merged.radar.spec.turn_period_s == pytest.approx(1e-3)
    path = save_studio(tmp_path, random_cube((3, *SHAPE)))
    with pytest.raises(ValueError, match="4 chirps of 2 transmitters"):
        open_recording(path, frames_as_chirps=True)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file or folder: .*cube.npy"):
        open_recording(tmp_path / "cube.npy")
    path = save(tmp_path, random_cube())
    with pytest.raises(FileNotFoundError, match="no such radar description"):
        open_recording(path, tmp_path / "other.toml")
    (tmp_path / "radar.toml").unlink()
    with pytest.raises(UsageError, match="no radar descriptions next to"):
        open_recording(path)


FRAME = "run/single_chip/adc_samples/data/frame_0.bin"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("cube.txt", "cube.txt is of no known format, expected a"),
        ("empty", "empty holds no recording, expected a folder"),
        (".", r"is not a recording; name one inside it: .*cube.npy"),
        (FRAME, "name the folder of its sequence"),
    ],
)
def test_other_paths_are_refused_with_what_was_expected(tmp_path, name, message):
    (tmp_path / "cube.txt").write_text("1")
    (tmp_path / "empty").mkdir()
    (tmp_path / FRAME).parent.mkdir(parents=True)
    (tmp_path / FRAME).write_bytes(b"1234")
    save(tmp_path, random_cube())
    assert is_recording(tmp_path / name) == (name == FRAME)  # by its name
    with pytest.raises(UsageError, match=message):
        open_recording(tmp_path / name)


OPTIONS = {"sensor": "cascade", "iq_order": "IIQQ", "allow_partial": True}
OPTIONS |= {"device": "awr1642", "description": "radar.toml"}
TAKEN = {
    ".npy": {"description", "device"},
    ".bin": {"description", "device", "iq_order", "allow_partial"},
    ".pcap": {"description", "device", "iq_order"},
    "folder": {"description", "sensor"},
    "capture": set(),
}


def test_every_reader_lists_its_options():
    taken = {*map(frozenset, (*TAKEN.values(), {"topic"}))}  # the last of bags alone
    assert {frozenset(reader.options) for reader in READERS} == taken


@pytest.mark.parametrize("option", OPTIONS)
@pytest.mark.parametrize("kind", TAKEN)
def test_options_of_other_formats_are_refused(tmp_path, kind, option):
    if option in TAKEN[kind]:
        return
    path = tmp_path / f"a{kind}" if kind.startswith(".") else tmp_path
    if kind == "folder":
        (path / "cascade" / "adc_samples").mkdir(parents=True)
    else:
        (path if path.suffix else path / "capture.toml").write_bytes(b"")
    with pytest.raises(UsageError, match=f"{option} = .* does not apply to .*{path}"):
        open_recording(path, **{option: OPTIONS[option]})


def test_a_format_is_one_entry_in_the_list(tmp_path, monkeypatch):
    save(tmp_path, random_cube())
    path = tmp_path / "cube.mat"
    path.write_bytes(b"")

    def open_mat(path, device=None):
        return open_recording(path.with_suffix(".npy"))._replace(name=device)

    def is_mat(path):
        return path.suffix == ".mat"

    reader = Format("a .mat cube", is_mat, open_mat, ("device",))
    monkeypatch.setattr("jradar.recordings.open.READERS", (reader, *READERS))
    assert is_recording(path)
    assert open_recording(path, device="board").name == "board"
    with pytest.raises(UsageError, match="sensor = 'a' does not apply .* a .mat cube"):
        open_recording(path, sensor="a")


def test_a_description_of_any_kind_serves_any_file(tmp_path):
    cube = random_cube()
    log = save_studio(tmp_path, [cube]).with_name("adc_LogFile.txt")
    path = save(tmp_path, cube)
    assert open_recording(path, log).radar.spec == read_description(log).radar
    binary = open_recording(tmp_path / "adc_data.bin", tmp_path / "radar.toml")
    np.testing.assert_array_equal(binary.cubes[0], cube)
    with pytest.raises(UsageError, match="device = 'awr1642' does not apply .*.toml"):
        open_recording(path, device="awr1642")
    with pytest.raises(UsageError, match="radar.yaml is of no known format"):
        (tmp_path / "radar.yaml").write_text("{}")
        open_recording(path, tmp_path / "radar.yaml")
