"""Complex cubes in .npy files: axes, converted samples, damaged files."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording
from tests.recordings.cube_writer import SHAPE, random_cube, save

FRAMES = ["frame", "tx", "rx", "chirp", "sample"]


def pairs(cube):
    """Samples as integers with I and Q along a last axis."""
    return np.stack([cube.real, cube.imag], -1).astype(np.int16)


def describe_more(folder, line):
    """Put a line into the [radar] table of the description."""
    radar = folder / "radar.toml"
    radar.write_text(radar.read_text().replace("num_samples", f"{line}\nnum_samples"))


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
    assert recording.notes == () and recording.cubes.stamps is None
    [found] = recording.cubes
    np.testing.assert_array_equal(found, cube)
    assert found.dtype == np.complex64


@pytest.mark.parametrize("stored", [np.asarray, pairs])
def test_frames_are_a_sequence_with_times(tmp_path, stored):
    many = random_cube((3, *SHAPE))
    path = save(tmp_path, stored(many), FRAMES)
    describe_more(tmp_path, "frame_period_s = 0.05")
    cubes = open_recording(path).cubes
    np.testing.assert_array_equal(np.stack([*cubes]), many)
    np.testing.assert_allclose(cubes.stamps, [0, 0.05, 0.1])


@pytest.mark.parametrize("kind", [np.int16, ">i2", np.uint16])
def test_pairs_of_16_bit_integers(tmp_path, kind):
    cube = random_cube()
    recording = open_recording(save(tmp_path, pairs(cube).astype(kind)))
    np.testing.assert_array_equal(recording.cubes[0], cube)
    assert recording.cubes[0].dtype == np.complex64
    unsigned = ["stored as unsigned" in note for note in recording.notes]
    assert unsigned == [True] * (kind == np.uint16)


def test_unsigned_samples_are_converted_and_positive_ones_left_alone(tmp_path):
    cube = random_cube()
    parts = pairs(cube).astype(np.uint16).astype(float)
    recording = open_recording(save(tmp_path, parts[..., 0] + 1j * parts[..., 1]))
    assert "stored as unsigned" in recording.notes[0]
    np.testing.assert_array_equal(recording.cubes[0], cube)
    positive = np.abs(cube.real) + 1j * np.abs(cube.imag)
    recording = open_recording(save(tmp_path, positive))
    np.testing.assert_array_equal(recording.cubes[0], positive)
    assert recording.notes == ()


@pytest.mark.parametrize("axes", [None, ["frame", "chirp", "sample"]])
@pytest.mark.parametrize("stored", [np.asarray, pairs])
def test_one_antenna(tmp_path, axes, stored):
    cube = random_cube((3, 4, 8) if axes else (4, 8))
    path = save(tmp_path, stored(cube), axes)
    with pytest.raises(ValueError, match=r"One antenna: tx_positions = \[\[0, 0\]\]"):
        open_recording(path)
    describe_more(tmp_path, "tx_positions = [[0, 0]]\nrx_positions = [[0, 0]]")
    cubes = open_recording(path).cubes
    np.testing.assert_array_equal(np.stack([*cubes])[:, 0, 0], cube.reshape(-1, 4, 8))


def test_real_samples_of_a_radar_with_one_mixer(tmp_path):
    cube = random_cube().real
    path = save(tmp_path, cube.astype(np.int16))
    describe_more(tmp_path, "real_samples = true")
    assert open_recording(path).cubes[0].dtype == np.float32
    np.testing.assert_array_equal(open_recording(path).cubes[0], cube)
    np.save(path, random_cube())
    with pytest.raises(ValueError, match="type complex64 .* expected real ones"):
        open_recording(path)


@pytest.mark.parametrize(
    ("array", "axes", "message"),
    [
        (random_cube((2, 4, 4, 9)), None, r"frames of \(2, 4, 4, 9\)"),
        (random_cube((4, 7, 8)), ["chirp", "virtual", "sample"], "7 virtual antennas"),
        (random_cube().real, None, "numbers of type float32 .* expected complex"),
        (np.zeros(()), None, "holds numbers of type float64"),
        (np.zeros((2, 2), "V8"), None, "holds numbers of type"),
        (random_cube((4, 4, 8)), None, r"has 3 axes \(4, 4, 8\), .*radar.toml names 4"),
        (random_cube(), ["tx", "rx", "chirps", "sample"], "'chirps', expected chirp"),
        (random_cube(), ["tx", "rx", "chirp", "chirp"], "each once"),
        (random_cube(), ["frame", "tx", "chirp", "sample"], "expected chirp, sample"),
        (random_cube(), "tx", "axes = 'tx', expected a list of names"),
        (random_cube(), [["tx"]], r"axes = \[\['tx'\]\], expected a list of names"),
        (random_cube((0, *SHAPE)), FRAMES, "holds no frames"),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path, array, axes, message):
    path = save(tmp_path, array, repr(axes) if axes else None)
    with pytest.raises(ValueError, match=message):
        open_recording(path)


def test_tables_and_samples_of_another_kind_are_refused(tmp_path):
    cube = random_cube()
    cube[0, 0, 1, 2:5] = np.nan
    path = save(tmp_path, cube)
    with pytest.raises(ValueError, match="3 samples of frame 0 are NaN or infinite"):
        open_recording(path).cubes[0]
    (tmp_path / "radar.toml").write_text("file = 3\n[radar]\ndevice = 'awr1642'\n")
    with pytest.raises(UsageError, match="radar.toml: file = 3, expected a table"):
        open_recording(path)


SHAPES = [(10**6, 10**6), (-1, 4, 4, 8), (-2, -2, 4, 8), (-1, 0, 4, 8)]


@pytest.mark.parametrize("fault", [0, 3, 60, 100, -1, "pickle", "archive", *SHAPES])
def test_truncated_lying_and_other_files_are_refused(tmp_path, fault):
    """`fault` is a number of bytes that are kept, a shape, or another kind of file."""
    path = save(tmp_path, random_cube())
    if fault == "pickle":
        np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    elif fault == "archive":
        with path.open("wb") as file:
            np.savez(file, cube=random_cube())
    elif isinstance(fault, tuple):
        header = np.lib.format.header_data_from_array_1_0(random_cube())
        with path.open("wb") as file:
            header = header | {"shape": fault}
            np.lib.format.write_array_header_1_0(file, header)
            file.write(bytes(4096))
    else:
        path.write_bytes(path.read_bytes()[:fault])
    with pytest.raises(ValueError, match="cube.npy is damaged or not a .npy") as found:
        open_recording(path)
    assert "allow_pickle" not in str(found.value)
