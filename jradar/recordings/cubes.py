"""Complex cubes that NumPy saved: cube.npy, and a .toml with its radar and axes.

    [radar]
    device = "awr1843"
    num_chirps = 64

    [file]
    axes = ["frame", "chirp", "tx", "rx", "sample"]

Without `[file]` the axes are tx, rx, chirp, sample; `virtual` stands for tx and rx.
"""

from pathlib import Path

import numpy as np

from jradar.errors import UsageError
from jradar.recordings.descriptions import find_description, read_description
from jradar.recordings.recording import Format, Recording, Stream
from jradar.recordings.text_files import check_names, toml

AXES = ("frame", "tx", "rx", "virtual", "chirp", "sample")
DEFAULT_AXES = ["tx", "rx", "chirp", "sample"]
WRAPPED = (
    "the samples were signed 16-bit numbers stored as unsigned ones (65535 for -1); "
    "they were converted back"
)


def open_npy(
    path: Path | str,
    description: Path | str | None = None,
    *,
    device: str | None = None,
) -> Recording:
    """Open a .npy cube; by default its description is the only .toml beside it.

    `device` is the board if the description is a .cfg. Raises UsageError for unknown
    axes, and ValueError for a damaged file and for sizes that do not fit the radar.
    """
    path = Path(path)
    description = Path(description or find_description(path, ["*.toml"]))
    radar, capture = read_description(description, device=device)
    axes = DEFAULT_AXES
    if description.suffix == ".toml":
        axes = toml(description).get("file", {}).get("axes", axes)
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise ValueError(f"{path} is not a whole .npy file: {error}") from error
    if array.dtype.kind != "c":
        raise ValueError(f"{path} holds {array.dtype}, expected complex numbers")
    frames = _order_axes(array, axes, radar, path, description)
    if not len(frames):
        raise ValueError(f"{path} holds no frames: its shape is {array.shape}")
    if frames.shape[1:] != radar.cube_shape:
        raise ValueError(
            f"{path} holds frames of {frames.shape[1:]} [tx, rx, chirp, sample], "
            f"{radar.name} needs {radar.cube_shape}: does the description belong to "
            "another recording?"
        )
    wrapped = _is_wrapped(np.asarray(frames[0]))

    def read(index: int) -> np.ndarray:
        frame = _unwrap(frames[index]) if wrapped else np.asarray(frames[index])
        cube = frame.astype(np.complex64)
        if bad := np.count_nonzero(~np.isfinite(cube)):
            raise ValueError(
                f"{path}: {bad:,} samples of frame {index} are NaN or infinite"
            )
        return cube

    return Recording(
        name=path.stem,
        path=path,
        radar=radar,
        cubes=Stream(read, len(frames)),
        channel_factors=capture.channel_array,
        range_bias_m=capture.range_bias_m,
        notes=(WRAPPED,) if wrapped else (),
    )


READER = Format(
    "a .npy cube with its .toml",
    lambda path: path.suffix == ".npy",
    open_npy,
    ("description", "device"),
)


def _order_axes(array, axes, radar, path, description):
    """Return `array` as [frame, tx, rx, chirp, sample]."""
    check_names(description, "axis", axes, AXES)
    antennas = {"virtual"} if "virtual" in axes else {"tx", "rx"}
    needed = antennas | {"chirp", "sample"}
    if len(axes) != len(set(axes)) or set(axes) - {"frame"} != needed:
        raise UsageError(
            f"{description}: axes = {axes}, expected chirp, sample, and tx and rx or "
            "virtual, each once, and frame if the file holds several"
        )
    if array.ndim != len(axes):
        raise ValueError(
            f"{path} has {array.ndim} axes {array.shape}, {description} names "
            f"{len(axes)}: {axes}"
        )
    sizes = dict(zip(axes, array.shape, strict=True))
    if "virtual" in sizes and sizes["virtual"] != radar.num_virtual:
        raise ValueError(
            f"{path} has {sizes['virtual']} virtual antennas, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    array = array.transpose([axes.index(name) for name in AXES if name in axes])
    if "frame" not in axes:
        array = array[None]
    if "virtual" in axes:
        array = array.reshape(len(array), radar.num_tx, radar.num_rx, *array.shape[2:])
    return array


def _is_wrapped(cube):
    """True if all parts are non-negative integers and many lie just below 65536."""
    parts = np.stack([cube.real, cube.imag])
    if not np.isfinite(parts).all() or parts.min() < 0 or parts.max() > 65535:
        return False
    return bool((parts > 32767).mean() > 0.05 and (parts == np.round(parts)).all())


def _unwrap(cube):
    """Return a cube with parts of 32768 and more read as negative int16."""
    parts = np.stack([cube.real, cube.imag]).astype(np.uint16).view(np.int16)
    return parts[0].astype(np.float32) + 1j * parts[1].astype(np.float32)
