"""Recordings of raw ADC samples, read one frame at a time.

Two kinds of file are read at this stage, each with a description of its radar:

    cube.npy + radar.toml            complex samples, the axes named in [file]
    adc_data.bin + LogFile.txt       mmWave Studio with a DCA1000, see `dca1000`

A recording is a sequence of complex64 cubes [tx, rx, chirp, sample].
"""

import dataclasses
import difflib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jradar.data import dca1000
from jradar.radar import RadarSpec
from jradar.radar.readers import toml

AXES = ("frame", "tx", "rx", "virtual", "chirp", "sample")
MAX_BYTES = 64 << 30


class Cubes(Sequence):
    """A recording: frames by index, its radar, and notes on what was mended."""

    def __init__(self, path: Path, radar: RadarSpec, frames: np.ndarray):
        """`frames` are [frame, tx, rx, chirp, sample], possibly mapped from a file."""
        self.path, self.radar, self.notes = path, radar, list[str]()
        self._frames = frames
        if frames.shape[1:] != radar.cube_shape:
            raise ValueError(
                f"{path} holds frames of {frames.shape[1:]} [tx, rx, chirp, sample], "
                f"{radar.name} needs {radar.cube_shape}: is it another radar's?"
            )

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int | slice) -> Any:
        """Frame `index`; ValueError where a sample is not finite."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"frame {index}, {self.path} has {len(self)}")
        cube = np.asarray(self._frames[index]).astype(np.complex64)
        if bad := np.count_nonzero(~np.isfinite(cube)):
            raise ValueError(
                f"{self.path}: {bad:,} samples of frame {index} are not finite numbers"
            )
        return cube


def open_cubes(
    path: Path | str,
    description: Path | str | None = None,
    *,
    frames_as_chirps: bool = False,
) -> Cubes:
    """Open a recording; its description is looked for beside it if it is not given.

    `frames_as_chirps` makes one frame of a recording with one chirp per frame: slow
    time then runs over the frames. Raises ValueError for what does not fit together.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such file: {path}")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, at most {MAX_BYTES:,} are read")
    description = Path(description) if description else _find_description(path)
    if not description.is_file():
        raise FileNotFoundError(f"no such radar description: {description}")
    if path.suffix == ".npy":
        cubes = _open_npy(path, description)
    elif path.suffix == ".bin":
        radar = RadarSpec.from_mmwave_studio_log(description)
        cubes = Cubes(path, radar, dca1000.read_adc_data(path, radar))
    else:
        raise ValueError(f"{path}: expected a .npy cube or a mmWave Studio .bin file")
    return _frames_as_chirps(cubes) if frames_as_chirps else cubes


def _find_description(path):
    """The only file beside `path` that can describe it."""
    patterns = {".npy": ["*.toml"], ".bin": ["*LogFile*.txt", "*LogFile*.csv"]}
    found = [f for p in patterns.get(path.suffix, []) for f in path.parent.glob(p)]
    if len(found) != 1:
        what = "no" if not found else f"{len(found)}"
        raise FileNotFoundError(
            f"{what} radar descriptions beside {path}: name one with --radar"
        )
    return found[0]


def _open_npy(path, description):
    """A cube that NumPy saved, its axes named in the description's [file] table."""
    radar = RadarSpec.from_toml(description)
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
    cubes = Cubes(path, radar, _order_axes(array, axes, radar, path, description))
    sample = np.asarray(cubes._frames[0])
    if _is_wrapped(sample):
        cubes._frames = _unwrap(np.asarray(cubes._frames))
        cubes.notes.append(
            "the samples were signed 16-bit numbers stored as unsigned ones "
            "(65535 for -1): mended"
        )
    return cubes


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


def _frames_as_chirps(cubes):
    """One frame whose chirps are the frames of a recording of single chirps."""
    radar = cubes.radar
    if radar.num_chirps != 1 or radar.num_tx != 1 or not radar.frame_period_s:
        raise ValueError(
            f"{cubes.path}: {radar.num_chirps} chirps of {radar.num_tx} transmitters "
            f"per frame, frame period {radar.frame_period_s} s: frames can serve as "
            "chirps where each is one chirp of one transmitter, at a known period"
        )
    slow = dataclasses.replace(
        radar,
        num_chirps=len(cubes),
        idle_time_s=radar.frame_period_s - radar.ramp_end_time_s,
        frame_period_s=0.0,
    )
    frames = np.asarray(cubes._frames)[None, ..., 0, :].transpose(0, 2, 3, 1, 4)
    merged = Cubes(cubes.path, slow, frames)
    merged.notes = [*cubes.notes, f"{len(cubes)} frames were taken as chirps of one"]
    return merged
