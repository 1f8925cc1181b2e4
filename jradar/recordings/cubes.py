"""Cubes that NumPy saved: cube.npy, and a .toml with its radar and axes.

    [radar]
    device = "awr1843"
    num_chirps = 64

    [file]
    axes = ["frame", "chirp", "tx", "rx", "sample"]

Samples are complex, or 16-bit integers with one more axis at the end: I, Q. A radar
with one mixer has real samples. Without `[file]` the axes are tx, rx, chirp, sample; of
two axes: chirp, sample. `virtual` stands for tx and rx.
"""

from pathlib import Path

import numpy as np

from jradar.errors import UsageError, parsing
from jradar.options.sensor import RadarSpec
from jradar.recordings.descriptions import (
    find_description,
    frame_stamps,
    read_description,
)
from jradar.recordings.recording import Format, Recording, Stream
from jradar.recordings.text_files import check_names, toml
from jradar.recordings.ti import lanes

AXES = ("frame", "tx", "rx", "virtual", "chirp", "sample")
DEFAULT_AXES = ("tx", "rx", "chirp", "sample")
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
    """Open a .npy cube; by default its description is the only .toml next to it.

    `device` is the board if the description is a .cfg. Raises UsageError for unknown
    axes, and ValueError for a damaged file and for sizes that do not fit the radar.
    """
    path = Path(path)
    description = Path(description or find_description(path, ["*.toml"]))
    radar, capture, notes = read_description(description, device=device)
    lanes.refuse(path, radar, capture)
    array = _map(path)
    pairs = _holds_pairs(path, array, radar)
    axes = [*(DEFAULT_AXES[-2:] if array.ndim - pairs == 2 else DEFAULT_AXES)]
    if description.suffix == ".toml":
        axes = _named_axes(description) or axes
    frames = _order_axes(array, axes, radar, path, description, pairs=pairs)
    if not len(frames):
        raise ValueError(f"{path} holds no frames: its shape is {array.shape}")
    if frames.shape[1:5] != radar.cube_shape:
        raise ValueError(
            f"{path} holds frames of {frames.shape[1:5]} [tx, rx, chirp, sample], "
            f"{radar.name} needs {radar.cube_shape}: does the description belong to "
            "another recording? (One antenna: tx_positions = [[0, 0]] and "
            "rx_positions = [[0, 0]] in [radar])"
        )

    def samples(index: int) -> np.ndarray:
        frame = np.asarray(frames[index])
        return frame[..., 0] + 1j * frame[..., 1].astype(float) if pairs else frame

    wrapped = not radar.real_samples and _is_wrapped(samples(0))

    def read(index: int) -> np.ndarray:
        frame = _unwrap(samples(index)) if wrapped else samples(index)
        cube = frame.astype(np.float32 if radar.real_samples else np.complex64)
        if bad := np.count_nonzero(~np.isfinite(cube)):
            raise ValueError(
                f"{path}: {bad:,} samples of frame {index} are NaN or infinite"
            )
        return cube

    stamps = frame_stamps(path, len(frames), radar.frame_period_s)
    return Recording(
        name=path.stem,
        path=path,
        radar=capture.radar(radar),
        cubes=Stream(read, len(frames), stamps),
        axes=tuple(axes),
        notes=(*notes, WRAPPED) if wrapped else notes,
    )


READER = Format(
    "a .npy cube with its .toml",
    lambda path: path.suffix == ".npy",
    open_npy,
    ("description", "device"),
)


def _map(path: Path) -> np.ndarray:
    """Return the array in a file; its samples are read when accessed."""
    with parsing(path, "a .npy file"):
        try:
            return np.lib.format.open_memmap(path, mode="r")
        except ValueError as error:
            if "max_header_size" in str(error):  # its advice is to trust the file
                raise ValueError("its header is too long") from error
            raise


def _holds_pairs(path: Path, array: np.ndarray, radar: RadarSpec) -> bool:
    """True if the last axis holds I and Q; ValueError for samples of a wrong kind."""
    kind, last = array.dtype.kind, array.shape[-1:]
    if radar.real_samples and kind in "if":
        return False
    if kind in "iu" and array.dtype.itemsize == 2 and last == (2,):
        return not radar.real_samples
    if radar.real_samples or kind != "c":
        expected = "complex ones, or int16 with a last axis I, Q"
        raise ValueError(
            f"{path} holds numbers of type {array.dtype} in the shape {array.shape}, "
            f"expected {'real ones' if radar.real_samples else expected}"
        )
    return False


def _named_axes(description: Path) -> list[str] | None:
    """Return the axes that a TOML file names; UsageError if they are not a list."""
    axes = toml(description).get("file", {}).get("axes")
    if axes is None:
        return None
    if not isinstance(axes, list) or not all(isinstance(name, str) for name in axes):
        raise UsageError(f"{description}: axes = {axes!r}, expected a list of names")
    check_names(description, "axis", axes, AXES)
    return axes


def _order_axes(array, axes, radar, path, description, *, pairs):
    """Return `array` as [frame, tx, rx, chirp, sample], and I, Q if it holds pairs."""
    antennas = set(axes) & {"tx", "rx", "virtual"}
    known = antennas in (set(), {"virtual"}, {"tx", "rx"})
    once = len(axes) == len(set(axes)) and {"chirp", "sample"} <= set(axes)
    if not known or not once:
        raise UsageError(
            f"{description}: axes = {axes}, expected chirp, sample, and tx and rx or "
            "virtual, each once, and frame if the file holds several"
        )
    if array.ndim - pairs != len(axes):
        raise ValueError(
            f"{path} has {array.ndim - pairs} axes {array.shape}, {description} names "
            f"{len(axes)}: {axes}"
        )
    sizes = dict(zip(axes, array.shape, strict=False))
    if "virtual" in sizes and sizes["virtual"] != radar.num_virtual:
        raise ValueError(
            f"{path} has {sizes['virtual']} virtual antennas, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    order = [axes.index(name) for name in AXES if name in axes]
    array = array.transpose([*order, len(axes)] if pairs else order)
    if "frame" not in axes:
        array = array[None]
    if "virtual" in axes:
        array = array.reshape(len(array), radar.num_tx, radar.num_rx, *array.shape[2:])
    return array if antennas else array[:, None, None]


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
