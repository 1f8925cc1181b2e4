"""Recordings written byte by byte come back; axes, mending, faults; real captures."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording

RADAR = """
[radar]
device = "awr1642"
num_chirps = 4
num_samples = 8
"""
LOG = """\
API:select_chip_version,AR1642,0,
API:ChannelConfig,3,15,0,
API:AdcOutConfig,2,1,0,
API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,8,10000,0,0,30,0,
API:ChirpConfig,0,0,0,0,0,0,0,1,0,
API:ChirpConfig,1,1,0,0,0,0,0,0,1,
API:FrameConfig,0,1,3,4,200000,0,512,0,
"""
SHAPE = (2, 4, 4, 8)  # tx, rx, chirp, sample


def random_cube(shape=SHAPE, seed=0):
    parts = np.random.default_rng(seed).integers(-2000, 2000, (2, *shape))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def save(folder, array, axes=None):
    np.save(folder / "cube.npy", array)
    file = f"[file]\naxes = {axes}\n" if axes else ""
    (folder / "radar.toml").write_text(RADAR + file)
    return folder / "cube.npy"


def save_studio(folder, cubes, log=LOG):
    """Frames [frame, tx, rx, chirp, sample] as I0 I1 Q0 Q1, chirp by chirp."""
    folder.mkdir(exist_ok=True)
    with (folder / "adc_data.bin").open("wb") as file:
        for frame in cubes:
            for chirp in range(frame.shape[2]):
                for tx, rx in np.ndindex(frame.shape[:2]):
                    samples = frame[tx, rx, chirp]
                    for n in range(0, len(samples), 2):
                        a, b = samples[n : n + 2]
                        words = [a.real, b.real, a.imag, b.imag]
                        file.write(np.array(words, "<i2").tobytes())
    (folder / "adc_LogFile.txt").write_text(log)
    return folder / "adc_data.bin"


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


def test_unsigned_samples_are_mended_and_said(tmp_path):
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


def test_studio_file_written_byte_by_byte(tmp_path):
    many = random_cube((3, *SHAPE))
    recording = open_recording(save_studio(tmp_path, many))
    assert recording.radar.frame_period_s == pytest.approx(1e-3)
    assert len(recording.cubes) == 3
    np.testing.assert_array_equal(np.stack([*recording.cubes]), many)


def test_frames_of_one_chirp_serve_as_slow_time(tmp_path):
    log = LOG.replace("FrameConfig,0,1,3,4,", "FrameConfig,0,0,5,1,")
    many = random_cube((5, 1, 4, 1, 8))
    path = save_studio(tmp_path, many, log)
    merged = open_recording(path, frames_as_chirps=True)
    assert len(merged.cubes) == 1
    assert "5 frames were taken as chirps" in merged.notes[-1]
    slow_time = many[:, :, :, 0].transpose(1, 2, 0, 3)
    np.testing.assert_array_equal(merged.cubes[0], slow_time)
    assert merged.radar.turn_period_s == pytest.approx(1e-3)
    with pytest.raises(ValueError, match="4 chirps of 2 transmitters"):
        open_recording(
            save_studio(tmp_path, random_cube((3, *SHAPE))), frames_as_chirps=True
        )


@pytest.mark.parametrize("cut", [1, 2, 100, 1024])
def test_truncated_studio_file_is_refused(tmp_path, cut):
    path = save_studio(tmp_path, random_cube((3, *SHAPE)))
    path.write_bytes(path.read_bytes()[:-cut])
    if cut == 1024:  # a whole frame is missing: two are left
        assert len(open_recording(path).cubes) == 2
        return
    with pytest.raises(
        ValueError, match=r"holds .* needs a multiple of 1,024 .* 2 whole"
    ):
        open_recording(path)


@pytest.mark.parametrize("keep", [0, 3, 60, 100, -1])
def test_truncated_npy_is_refused(tmp_path, keep):
    path = save(tmp_path, random_cube())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match="not a whole .npy file"):
        open_recording(path)


def test_pickles_and_lying_headers_are_refused(tmp_path):
    path = save(tmp_path, random_cube())
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match="not a whole .npy file"):
        open_recording(path)
    header = np.lib.format.header_data_from_array_1_0(random_cube())
    with path.open("wb") as file:
        header["shape"] = (10**6, 10**6)
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match="not a whole .npy file"):
        open_recording(path)


@pytest.mark.parametrize(
    ("array", "axes", "message"),
    [
        (random_cube((2, 4, 4, 9)), None, r"frames of \(2, 4, 4, 9\)"),
        (random_cube((4, 7, 8)), ["chirp", "virtual", "sample"], "7 virtual antennas"),
        (random_cube().real, None, "holds float32, expected complex"),
        (random_cube((4, 4, 8)), None, r"has 3 axes \(4, 4, 8\), .*radar.toml names 4"),
        (random_cube(), ["tx", "rx", "chirps", "sample"], "'chirps', expected chirp"),
        (random_cube(), ["tx", "rx", "chirp", "chirp"], "each once"),
        (random_cube(), ["frame", "tx", "chirp", "sample"], "expected chirp, sample"),
    ],
)
def test_what_does_not_fit_together_is_refused(tmp_path, array, axes, message):
    with pytest.raises(ValueError, match=message):
        open_recording(save(tmp_path, array, axes))


def test_samples_that_are_not_numbers_are_refused(tmp_path):
    cube = random_cube()
    cube[0, 0, 1, 2:5] = np.nan
    with pytest.raises(ValueError, match="3 samples of frame 0 are NaN or infinite"):
        open_recording(save(tmp_path, cube)).cubes[0]


def test_missing_files_are_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file or folder: .*cube.npy"):
        open_recording(tmp_path / "cube.npy")
    path = save(tmp_path, random_cube())
    with pytest.raises(FileNotFoundError, match="no such radar description"):
        open_recording(path, tmp_path / "other.toml")
    (tmp_path / "second.toml").write_text(RADAR)
    with pytest.raises(UsageError, match="2 radar descriptions beside"):
        open_recording(path)
    for extra in tmp_path.glob("*.toml"):
        extra.unlink()
    with pytest.raises(UsageError, match="no radar descriptions beside"):
        open_recording(path)


def test_real_studio_capture(samples):
    path = samples / "dca1000" / "adc_data_0.bin"
    cubes = open_recording(path).cubes
    assert len(cubes) == 1000 and cubes[0].shape == (1, 4, 1, 256)
    merged = open_recording(path, frames_as_chirps=True).cubes
    assert merged[0].shape == (1, 4, 1000, 256)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda d: d / "cube.txt", r"cube.txt is of no known format, expected a"),
        (lambda d: d / "empty", "empty holds no recording, expected a folder"),
        (lambda d: d, r"is not a recording; name one inside it: .*cube.npy"),
    ],
)
def test_what_is_no_recording_is_told_what_was_looked_for(tmp_path, make, message):
    (tmp_path / "cube.txt").write_text("1")
    (tmp_path / "empty").mkdir()
    save(tmp_path, random_cube())
    with pytest.raises(ValueError, match=message):
        open_recording(make(tmp_path))


@pytest.mark.parametrize("option", [{"sensor": "cascade"}, {"iq_order": "iq"}])
def test_options_of_other_formats_are_refused(tmp_path, option):
    with pytest.raises(ValueError, match="does not apply to .*cube.npy"):
        open_recording(save(tmp_path, random_cube()), **option)


def test_no_frames_are_no_recording(tmp_path):
    axes = ["frame", "tx", "rx", "chirp", "sample"]
    with pytest.raises(ValueError, match="holds no frames"):
        open_recording(save(tmp_path, random_cube((0, *SHAPE)), axes))


def test_a_capture_says_all_in_its_own_file(tmp_path):
    many = random_cube((3, *SHAPE))
    save_studio(tmp_path / "run", many)
    (tmp_path / "run" / "capture.toml").write_text(
        '[radar]\nfile = "adc_data.bin"\ndescription = "adc_LogFile.txt"\n'
    )
    for path in (tmp_path / "run", tmp_path / "run" / "capture.toml"):
        np.testing.assert_array_equal(open_recording(path).cubes[2], many[2])
    for option in ({"sensor": "cascade"}, {"description": "radar.toml"}):
        with pytest.raises(ValueError, match="to .*, a folder with a capture.toml"):
            open_recording(tmp_path / "run", **option)
    with pytest.raises(ValueError, match="name one inside it: .*run"):
        open_recording(tmp_path)


def test_the_whole_frames_of_a_capture_that_was_cut_off(tmp_path):
    many = random_cube((3, *SHAPE))
    path = save_studio(tmp_path, many)
    path.write_bytes(path.read_bytes()[:-5])
    cubes = open_recording(path, allow_partial=True).cubes
    np.testing.assert_array_equal(np.stack([*cubes]), many[:2])


def test_a_frame_of_a_sequence_is_no_capture(tmp_path):
    path = tmp_path / "run/single_chip/adc_samples/data/frame_0.bin"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"1234")
    with pytest.raises(ValueError, match="name the folder of the sequence"):
        open_recording(path)
