"""Complex cubes in .npy files: axes, mended samples, damaged files."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording
from tests.recordings.cube_writer import SHAPE, random_cube, save


@pytest.mark.parametrize(
    ("axes", "order", "shape"),
    [
        (None, (0, 1, 2, 3), None),
        (["chirp", "tx", "rx", "sample"], (2, 0, 1, 3), None),
        (["sample", "chirp", "virtual"], (3, 2, 0, 1), (8, 4, 8)),
    ],
)
def test_named_axes_are_put_in_order(tmp_path, axes, order, shape):
    cube = random_cube()
    array = cube.transpose(order).reshape(shape or np.array(SHAPE)[[*order]])
    recording = open_recording(save(tmp_path, array, axes))
    cubes = recording.cubes
    assert len(cubes) == 1 and not recording.notes
    assert cubes[0].dtype == np.complex64
    np.testing.assert_array_equal(cubes[0], cube)


def test_frames_are_a_sequence(tmp_path):
    many = random_cube((3, *SHAPE))
    axes = ["frame", "tx", "rx", "chirp", "sample"]
    cubes = open_recording(save(tmp_path, many, axes)).cubes
    assert len(cubes) == 3
    np.testing.assert_array_equal(cubes[2], many[2])
    np.testing.assert_array_equal(cubes[-1], many[2])
    np.testing.assert_array_equal(np.stack([*cubes]), many)
    np.testing.assert_array_equal(np.stack(cubes[1:]), many[1:])
    with pytest.raises(IndexError, match="item 3 of a stream of 3"):
        cubes[3]


def test_unsigned_samples_are_converted_and_reported(tmp_path):
    cube = random_cube()
    wrapped = np.where(cube.real < 0, cube.real + 65536, cube.real) + 1j * np.where(
        cube.imag < 0, cube.imag + 65536, cube.imag
    )
    recording = open_recording(save(tmp_path, wrapped.astype(np.complex128)))
    assert "stored as unsigned" in recording.notes[0]
    np.testing.assert_array_equal(recording.cubes[0], cube)


def test_positive_samples_are_left_alone(tmp_path):
    cube = np.abs(random_cube().real) + 1j * np.abs(random_cube().imag)
    recording = open_recording(save(tmp_path, cube))
    assert not recording.notes
    np.testing.assert_array_equal(recording.cubes[0], cube)


@pytest.mark.parametrize("keep", [0, 3, 60, 100, -1])
def test_truncated_npy_is_refused(tmp_path, keep):
    path = save(tmp_path, random_cube())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy file"):
        open_recording(path)


def test_pickles_and_lying_headers_are_refused(tmp_path):
    path = save(tmp_path, random_cube())
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy file"):
        open_recording(path)
    header = np.lib.format.header_data_from_array_1_0(random_cube())
    with path.open("wb") as file:
        header["shape"] = (10**6, 10**6)
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy file"):
        open_recording(path)


@pytest.mark.parametrize(
    ("array", "axes", "message"),
    [
        (random_cube((2, 4, 4, 9)), None, r"frames of \(2, 4, 4, 9\)"),
        (random_cube((4, 7, 8)), ["chirp", "virtual", "sample"], "7 virtual antennas"),
        (random_cube().real, None, "numbers of type float32 .* expected complex"),
        (random_cube((4, 4, 8)), None, r"has 3 axes \(4, 4, 8\), .*radar.toml names 4"),
        (random_cube(), ["tx", "rx", "chirps", "sample"], "'chirps', expected chirp"),
        (random_cube(), ["tx", "rx", "chirp", "chirp"], "each once"),
        (random_cube(), ["frame", "tx", "chirp", "sample"], "expected chirp, sample"),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path, array, axes, message):
    with pytest.raises(ValueError, match=message):
        open_recording(save(tmp_path, array, axes))


def integers(cube):
    return np.stack([cube.real, cube.imag], -1).astype(np.int16)


@pytest.mark.parametrize("kind", [np.int16, ">i2", np.uint16])
def test_pairs_of_16_bit_integers(tmp_path, kind):
    cube = random_cube()
    recording = open_recording(save(tmp_path, integers(cube).astype(kind)))
    np.testing.assert_array_equal(recording.cubes[0], cube)
    assert recording.cubes[0].dtype == np.complex64
    assert [note[:7] for note in recording.notes] == ["the sam"] * (kind == np.uint16)


def test_pairs_with_named_axes(tmp_path):
    many = random_cube((3, *SHAPE))
    stored = integers(many).transpose(0, 3, 1, 2, 4, 5)
    axes = ["frame", "chirp", "tx", "rx", "sample"]
    cubes = open_recording(save(tmp_path, stored, axes)).cubes
    np.testing.assert_array_equal(np.stack([*cubes]), many)


ONE_ANTENNA = "tx_positions = [[0, 0]]\nrx_positions = [[0, 0]]\n"


@pytest.mark.parametrize("axes", [None, ["frame", "chirp", "sample"]])
@pytest.mark.parametrize("pairs", [False, True])
def test_one_antenna(tmp_path, axes, pairs):
    cube = random_cube((3, 4, 8) if axes else (4, 8))
    path = save(tmp_path, integers(cube) if pairs else cube, axes)
    with pytest.raises(ValueError, match=r"One antenna: tx_positions = \[\[0, 0\]\]"):
        open_recording(path)
    description = (tmp_path / "radar.toml").read_text()
    head, *rest = description.partition("[file]")
    (tmp_path / "radar.toml").write_text(head + ONE_ANTENNA + "".join(rest))
    cubes = open_recording(path).cubes
    np.testing.assert_array_equal(np.stack([*cubes])[:, 0, 0], cube.reshape(-1, 4, 8))


def test_real_samples_of_a_radar_with_one_mixer(tmp_path):
    cube = random_cube().real
    path = save(tmp_path, cube.astype(np.int16))
    radar = tmp_path / "radar.toml"
    radar.write_text(radar.read_text() + "real_samples = true\n")
    assert open_recording(path).cubes[0].dtype == np.float32
    np.testing.assert_array_equal(open_recording(path).cubes[0], cube)
    np.save(path, random_cube())
    with pytest.raises(ValueError, match="type complex64 .* expected real ones"):
        open_recording(path)


def test_a_damaged_header_is_named(tmp_path):
    """A flipped bit of the header is refused, or leaves samples of the same size."""
    path = save(tmp_path, random_cube())
    content = path.read_bytes()
    for bit in range(0, 8 * 128, 5):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        try:
            assert open_recording(path).cubes[0].shape == SHAPE
        except ValueError as error:
            message = str(error)
            assert "cube.npy" in message and "allow_pickle" not in message


@pytest.mark.parametrize("shape", [(-1, 4, 4, 8), (-2, -2, 4, 8), (-1, 0, 4, 8)])
def test_negative_shapes_are_refused(tmp_path, shape):
    path = save(tmp_path, random_cube())
    header = np.lib.format.header_data_from_array_1_0(random_cube())
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header | {"shape": shape})
        file.write(bytes(4096))
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy file"):
        open_recording(path)


def test_other_kinds_of_files_named_npy(tmp_path):
    path = save(tmp_path, random_cube())
    np.savez(tmp_path / "cube.npz", cube=random_cube())
    (tmp_path / "cube.npz").rename(path)
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy file"):
        open_recording(path)
    for value in (np.zeros(3), np.zeros(()), np.zeros((2, 2), "V8"), np.zeros(2, "U3")):
        np.save(path, value)
        with pytest.raises(ValueError, match="cube.npy holds numbers of type"):
            open_recording(path)


@pytest.mark.parametrize("axes", ["3", "[1, 2]", "{a = 1}", "'tx'", "[['tx']]"])
def test_axes_that_are_no_list_of_names(tmp_path, axes):
    path = save(tmp_path, random_cube())
    radar = tmp_path / "radar.toml"
    radar.write_text(radar.read_text() + f"[file]\naxes = {axes}\n")
    with pytest.raises(UsageError, match="radar.toml: axes"):
        open_recording(path)
    radar.write_text("file = 3\n" + radar.read_text().partition("[file]")[0])
    with pytest.raises(UsageError, match="radar.toml: file = 3"):
        open_recording(path)


def test_samples_that_are_not_numbers_are_refused(tmp_path):
    cube = random_cube()
    cube[0, 0, 1, 2:5] = np.nan
    with pytest.raises(ValueError, match="3 samples of frame 0 are NaN or infinite"):
        open_recording(save(tmp_path, cube)).cubes[0]


def test_a_file_without_frames_is_refused(tmp_path):
    axes = ["frame", "tx", "rx", "chirp", "sample"]
    with pytest.raises(ValueError, match="holds no frames"):
        open_recording(save(tmp_path, random_cube((0, *SHAPE)), axes))
