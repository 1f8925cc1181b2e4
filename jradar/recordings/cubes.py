"""`open_recording`: whatever a path names, as a `Recording`.

cube.npy + radar.toml            complex samples, the axes named in [file]
adc_data.bin + LogFile.txt       a DCA1000's samples, with the log of mmWave Studio
adc_data.bin + radar.cfg         or the .cfg of TI's mmWave SDK, see `dca1000`
sequence/                        of ColoRadar, see `coloradar`
folder/ with a capture.toml      radar, LiDAR and poses of one's own, see `capture`
"""

import dataclasses
import difflib
from pathlib import Path

import numpy as np

from jradar.radar import RadarSpec
from jradar.recordings.capture import open_capture
from jradar.recordings.coloradar import is_coloradar, open_coloradar
from jradar.recordings.dca1000 import open_dca1000
from jradar.recordings.recording import Recording, Stream
from jradar.recordings.text_files import radar_from_toml, toml

CAPTURE = "capture.toml"
AXES = ("frame", "tx", "rx", "virtual", "chirp", "sample")
MAX_BYTES = 64 << 30
DESCRIPTIONS = {
    ".npy": ("*.toml",),
    ".bin": ("*LogFile*.txt", "*LogFile*.csv", "*.cfg", "*.toml"),
}
EXPECTED = (
    "expected a .npy cube with the .toml that describes it, an adc_data.bin with its "
    "mmWave Studio log, .cfg or .toml, a folder with a capture.toml, or a sequence of "
    "ColoRadar, a folder with single_chip/adc_samples or cascade/adc_samples"
)


def open_recording(
    path: Path | str,
    description: Path | str | None = None,
    *,
    sensor: str | None = None,
    frames_as_chirps: bool = False,
    iq_order: str | None = None,
    allow_partial: bool = False,
    device: str | None = None,
) -> Recording:
    """Open a recording of any kind; its description is looked for if it is not given.

    `description` is the TOML file, log or .cfg of a file, or the `calib` folder of a
    ColoRadar sequence, of which `sensor` picks the radar. `frames_as_chirps` makes one
    frame of a recording with one chirp per frame: slow time then runs over the frames.
    `iq_order` replaces what the description of an adc_data.bin says, `allow_partial`
    takes the whole frames of one that was cut off, `device` is the board of its .cfg.
    Raises ValueError for what does not fit together.
    """
    path = Path(path)
    path = path.parent if path.name == CAPTURE else path
    if not path.exists():
        raise FileNotFoundError(f"no such file or folder: {path}")
    has_capture = (path / CAPTURE).is_file()
    for name, value, taken in (
        ("description", description, not has_capture),
        ("sensor", sensor, path.is_dir() and not has_capture),
        ("iq_order", iq_order, path.suffix == ".bin"),
        ("allow_partial", allow_partial or None, path.suffix == ".bin"),
        ("device", device, path.suffix == ".bin"),
    ):
        if value is not None and not taken:
            raise ValueError(
                f"{name} = {value!r} has no meaning for {path}: sensor is for "
                "sequences of ColoRadar, iq_order, allow_partial and device for "
                "adc_data.bin; "
                "a capture.toml says all of its capture"
            )
    if path.is_dir():
        recording = _open_folder(path, description, sensor)
    elif path.suffix == ".npy":
        recording = _open_npy(path, _description(path, description))
    elif path.suffix == ".bin":
        recording = open_dca1000(
            path,
            _description(path, description),
            iq_order=iq_order,
            allow_partial=allow_partial,
            **({} if device is None else {"device": device}),
        )
    else:
        raise ValueError(f"{path} is no recording: {EXPECTED}")
    return _frames_as_chirps(recording) if frames_as_chirps else recording


def _open_folder(path: Path, description, sensor: str | None) -> Recording:
    """A capture or a sequence; for other folders an error that says what they hold."""
    if (path / CAPTURE).is_file():
        return open_capture(path)
    if is_coloradar(path):
        return open_coloradar(path, sensor=sensor, calib=description)
    inside = [*path.glob("*"), *path.glob("kitti/*")]
    found = [
        p
        for p in inside
        if p.suffix in DESCRIPTIONS or is_coloradar(p) or (p / CAPTURE).is_file()
    ]
    if found:
        names = [str(p) for p in sorted(found)]
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        raise ValueError(
            f"{path} is no recording itself, name one that it holds: "
            f"{', '.join(names[:5])}{more}"
        )
    raise ValueError(f"{path} holds no recording: {EXPECTED}")


def _description(path: Path, description: Path | str | None) -> Path:
    """The description that was named, or the only file beside `path` that can be it."""
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, at most {MAX_BYTES:,} are read")
    if description is not None:
        if not Path(description).is_file():
            raise FileNotFoundError(f"no such radar description: {description}")
        return Path(description)
    if "adc_samples" in path.parts:
        raise ValueError(
            f"{path} looks like one frame of ColoRadar: name the folder of its "
            "sequence, and the frame with --frame"
        )
    patterns = DESCRIPTIONS[path.suffix]
    found = sorted({f for p in patterns for f in path.parent.glob(p)})
    if len(found) != 1:
        names = f" ({', '.join(f.name for f in found[:5])})" if found else ""
        raise FileNotFoundError(
            f"{len(found) or 'no'} radar descriptions beside {path}{names}, looked for "
            f"{', '.join(patterns)}: name one with --radar"
        )
    return found[0]


def _recording(path: Path, radar: RadarSpec, frames, read=None, notes=()) -> Recording:
    """A recording of `frames` [frame, tx, rx, chirp, sample], mapped from a file.

    `read(i)` returns a frame where it must be mended first.
    """
    if frames.shape[1:] != radar.cube_shape:
        raise ValueError(
            f"{path} holds frames of {frames.shape[1:]} [tx, rx, chirp, sample], "
            f"{radar.name} needs {radar.cube_shape}: is it another radar's?"
        )

    def finite(index: int) -> np.ndarray:
        frame = read(index) if read else frames[index]
        cube = np.asarray(frame).astype(np.complex64)
        if bad := np.count_nonzero(~np.isfinite(cube)):
            raise ValueError(
                f"{path}: {bad:,} samples of frame {index} are not finite numbers"
            )
        return cube

    stream = Stream(finite, len(frames))
    return Recording(path.stem, path, radar, stream, notes=tuple(notes))


def _open_npy(path: Path, description: Path) -> Recording:
    """A cube that NumPy saved, its axes named in the description's [file] table."""
    radar = radar_from_toml(description)
    options = toml(description).get("file", {})
    if unknown := sorted(set(options) - {"axes"}):
        raise ValueError(f"{description}: unknown [file] field {unknown[0]!r}")
    axes = options.get("axes", ["tx", "rx", "chirp", "sample"])
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{path} is not a whole .npy file: {error}") from error
    if array.dtype.kind != "c":
        raise ValueError(f"{path} holds {array.dtype}, expected complex numbers")
    frames = _order_axes(array, axes, radar, path, description)
    if not len(frames):
        raise ValueError(f"{path} holds no frames: its shape is {array.shape}")
    if not _is_wrapped(np.asarray(frames[0])):
        return _recording(path, radar, frames)
    note = (
        "the samples were signed 16-bit numbers stored as unsigned ones "
        "(65535 for -1): mended"
    )
    return _recording(path, radar, frames, lambda i: _unwrap(frames[i]), [note])


def _order_axes(array, axes, radar, path, description):
    """`array` with its named axes as [frame, tx, rx, chirp, sample]."""
    for name in axes:
        if name not in AXES:
            near = difflib.get_close_matches(str(name), AXES, 1) or [", ".join(AXES)]
            raise ValueError(
                f"{description}: unknown axis {name!r}, expected {near[0]}"
            )
    antennas = {"virtual"} if "virtual" in axes else {"tx", "rx"}
    if len(axes) != len(set(axes)) or set(axes) - {"frame"} != antennas | {
        "chirp",
        "sample",
    }:
        raise ValueError(
            f"{description}: axes = {axes}, expected chirp, sample, and tx and rx or "
            "virtual, each once, and frame where there are several"
        )
    if array.ndim != len(axes):
        raise ValueError(f"{path} has {array.ndim} axes {array.shape}, {axes=}")
    sizes = dict(zip(axes, array.shape, strict=True))
    if "virtual" in sizes and sizes["virtual"] != radar.num_virtual:
        raise ValueError(
            f"{path} has {sizes['virtual']} virtual antennas, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    wanted = [name for name in AXES if name in axes]
    array = array.transpose([axes.index(name) for name in wanted])
    if "frame" not in axes:
        array = array[None]
    if "virtual" in axes:
        pair = (radar.num_tx, radar.num_rx)
        array = array.reshape(array.shape[0], *pair, *array.shape[2:])
    return array


def _is_wrapped(cube):
    """Whether all parts are whole, never negative, and many lie just below 65536."""
    parts = np.stack([cube.real, cube.imag])
    if not np.isfinite(parts).all() or parts.min() < 0 or parts.max() > 65535:
        return False
    return bool((parts > 32767).mean() > 0.05 and (parts == np.round(parts)).all())


def _unwrap(cube):
    """Parts of 32768 and more are the negative numbers of 16 bits."""
    real, imaginary = (
        part.astype(np.uint16).view(np.int16).astype(np.float32)
        for part in (cube.real, cube.imag)
    )
    return real + 1j * imaginary


def _frames_as_chirps(recording: Recording) -> Recording:
    """One frame whose chirps are the frames of a recording of single chirps."""
    radar, cubes, path = recording.radar, recording.cubes, recording.path
    if radar.num_chirps != 1 or radar.num_tx != 1 or not radar.frame_period_s:
        raise ValueError(
            f"{path}: {radar.num_chirps} chirps of {radar.num_tx} transmitters "
            f"per frame, frame period {radar.frame_period_s} s: frames can serve as "
            "chirps where each is one chirp of one transmitter, at a known period"
        )
    slow = dataclasses.replace(
        radar,
        num_chirps=len(cubes),
        idle_time_s=radar.frame_period_s - radar.ramp_end_time_s,
        frame_period_s=0.0,
    )
    return recording._replace(
        radar=slow,
        cubes=Stream(lambda _: np.concatenate([*cubes], axis=2), 1),
        lost_bytes=None
        if recording.lost_bytes is None
        else recording.lost_bytes.sum(keepdims=True),
        notes=(*recording.notes, f"{len(cubes)} frames were taken as chirps of one"),
    )
