"""How fast do recordings become training pairs, and pairs images?

A frame has the size of ColoRadar's: 786 kB of ADC samples and a scan of 65,536 points,
from a simulated hallway. The peer of preparation loops over the scan's points in
Python, as published preprocessing does, and computes only the LiDAR image. The peer of
loading reads the same arrays from one compressed NumPy file per frame.
"""

import atexit
import functools
import math
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.harness import Case
from jradar.data import (
    PairSource,
    PrepareSpec,
    Records,
    matches_of,
    prepare,
    prepare_frame,
)
from jradar.data.records import to_bytes
from jradar.range_image import ImageSpec
from jradar.recordings import open_recording
from jradar.simulation import simulate_sequence

SPEC = PrepareSpec()
FRAMES = 6
VIEW = SPEC.lidar.azimuth, SPEC.lidar.elevation, SPEC.lidar.max_range_m
COARSE, FINE = ImageSpec(64, 64, *VIEW), ImageSpec(128, 512, *VIEW)


def cases() -> Iterator[Case]:
    """Yield the preparation of a frame, and loading it as images."""
    root = _temporary()
    recording = open_recording(simulate_sequence("hallways", 0, root, frames=FRAMES))
    assert recording.lidar is not None
    i, j = (int(index[0]) for index in matches_of(recording, SPEC)[:2])
    scan = recording.lidar[j][:, :3]
    loop = {"Python loop over points, image only": lambda: _loop(scan, FINE)}
    frame = prepare_frame(recording, i, j, SPEC)[0]
    whole = functools.partial(prepare_frame, recording, i, j, SPEC)
    yield Case("prepare a frame, files to record", lambda: to_bytes(whole()[0]), loop)

    prepare(root, root / "records", SPEC, workers=1)
    pairs = PairSource(Records(root / "records"), COARSE, FINE, num_slices=8)
    fields = frame.cells._asdict().items()
    cells = {f"cells_{name}": v for name, v in fields if v is not None}
    points = {k: v for k, v in frame.radar._asdict().items() if v is not None}
    arrays = cells | points | {"lidar": frame.lidar_xyz}
    np.savez_compressed(root / "frame.npz", **arrays)
    yield Case(
        "load a pair, record to 64 x 64 x 24 and 128 x 512",
        lambda: pairs[1],
        {"compressed npz, no images": lambda: _read_npz(root / "frame.npz")},
    )


def _temporary():
    """Return a folder that is deleted at exit."""
    root = Path(tempfile.mkdtemp())
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root


def _loop(xyz, spec):
    """Return the range image of a scan, computed point by point."""
    image = np.zeros(spec.shape)
    (low, high), (bottom, top) = spec.azimuth, spec.elevation
    for x, y, z in xyz.tolist():
        distance = math.sqrt(x * x + y * y + z * z)
        if not 0 < distance < spec.max_range_m:
            continue
        column = int((math.atan2(y, x) - low) * spec.width / (high - low))
        row = int((top - math.asin(z / distance)) * spec.height / (top - bottom))
        if 0 <= row < spec.height and 0 <= column < spec.width:
            if not 0 < image[row, column] < distance:
                image[row, column] = distance
    return image


def _read_npz(path):
    with np.load(path, allow_pickle=False) as file:
        return [file[name] for name in file]
