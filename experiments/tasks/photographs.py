"""A folder of photographs as luminance crops, each a pure function of its generator.

JPEG, PNG and WebP files are found by name, also in subfolders, and their headers are
read. Pixels are decoded on access, and the last ones are cached. Files that are not
such images, are too large or smaller than a crop are left out, each with its reason.
"""

import functools
import hashlib
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageOps

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp")
FORMATS = ("JPEG", "PNG", "WEBP")
MODES = ("L", "LA", "P", "RGB", "RGBA", "CMYK", "YCbCr")  # 8 bits per channel
MAX_FILE_BYTES = 1 << 26
MAX_PIXELS = 1 << 26
KEPT_PIXELS = 1 << 22  # larger photographs are shrunk on reading
KEPT = 64  # photographs in memory
ORIENTATION = 0x0112  # EXIF tag; values of 5 and more exchange rows and columns


class Photographs(Sequence):
    """Luminances [row, column] of a folder's usable files, in order of names."""

    def __init__(self, folder: Path | str, *, smallest: tuple[int, int]):
        """`smallest` is the least number of rows and columns of a photograph.

        `skipped` maps each file that was left out to the reason. Raises
        FileNotFoundError without the folder, ValueError without a usable file.
        """
        self.folder, self.skipped = Path(folder), dict[str, str]()
        if not self.folder.is_dir():
            raise FileNotFoundError(f"no such folder: {self.folder}")
        self._paths: list[Path] = []
        for path in sorted(self.folder.rglob("*")):
            if path.suffix.lower() not in SUFFIXES or not path.is_file():
                continue
            if fault := _fault(path, smallest):
                self.skipped[str(path)] = fault
            else:
                self._paths.append(path)
        if not self._paths:
            first = "".join(f"; {k}: {v}" for k, v in [*self.skipped.items()][:1])
            raise ValueError(
                f"{self.folder} contains no photographs of at least {smallest[1]} x "
                f"{smallest[0]} pixels as {SUFFIXES}{first}"
            )
        self._read = functools.lru_cache(KEPT)(
            lambda index: _luminance(self._paths[index], smallest)
        )

    @property
    def digest(self) -> str:
        """SHA-256 over relative names and sizes of the usable files."""
        names = [
            f"{p.relative_to(self.folder)} {p.stat().st_size}" for p in self._paths
        ]
        return hashlib.sha256("\n".join(names).encode()).hexdigest()

    def __len__(self) -> int:
        return len(self._paths)

    def __getitem__(self, index: Any) -> UInt8[np.ndarray, "row column"]:
        """Return photograph `index`. Raises ValueError for a damaged file."""
        return self._read(range(len(self))[index])


def crop(
    rng: np.random.Generator,
    photograph: UInt8[np.ndarray, "row column"],
    shape: tuple[int, int],
) -> Float[np.ndarray, "crop_row crop_column"]:
    """Return a random part of a photograph as `shape` pixels, -1 (black) to 1.

    Its place, its size (from `shape` to the whole photograph) and a left-right flip are
    drawn from `rng`. Larger parts are averaged down.
    """
    rows, columns = photograph.shape
    largest = min(rows / shape[0], columns / shape[1])
    scale = np.exp(rng.uniform(0, np.log(largest))) if largest > 1 else 1.0
    height, width = shape[0] * scale, shape[1] * scale
    top, left = rng.uniform(0, (max(rows - height, 0), max(columns - width, 0)))
    part = Image.fromarray(photograph).resize(
        shape[::-1],
        Image.Resampling.BILINEAR,
        box=(left, top, min(left + width, columns), min(top + height, rows)),
    )
    values = np.asarray(part, np.float32) / 127.5 - 1
    return values[:, ::-1] if rng.random() < 0.5 else values


def _open(path):
    """The image of a file, not yet decoded, read as one of FORMATS."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its size is checked by `_fault`
        return Image.open(path, formats=FORMATS)


def _fault(path, smallest):
    """Why a file's header makes it unusable; an empty text for a usable file."""
    if (size := path.stat().st_size) > MAX_FILE_BYTES:
        return f"{size:,} bytes, expected at most {MAX_FILE_BYTES:,}"
    try:
        with _open(path) as image:
            columns, rows = image.size
            mode = image.mode
            # Reading EXIF from a PNG would decode the whole image.
            if image.format != "PNG" and image.getexif().get(ORIENTATION, 1) >= 5:
                columns, rows = rows, columns
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        return f"not usable: {error}"
    if rows * columns > MAX_PIXELS:
        return f"{columns} x {rows} pixels, expected at most {MAX_PIXELS:,}"
    if mode not in MODES:
        return f"mode {mode}, expected one of {MODES}"
    if rows < smallest[0] or columns < smallest[1]:
        return f"{columns} x {rows} pixels, expected {smallest[1]} x {smallest[0]}"
    return ""


def _luminance(path, smallest):
    """Pixels of a file, upright; at most KEPT_PIXELS, unless a crop needs more."""
    try:
        with _open(path) as image:
            image.draft("L", image.size)  # a JPEG decodes faster without colours
            image = ImageOps.exif_transpose(image.convert("L"))
    except (OSError, SyntaxError, ValueError) as error:
        raise ValueError(f"{path} is damaged, remove it: {error}") from error
    columns, rows = image.size
    shrink = (KEPT_PIXELS / (rows * columns)) ** 0.5
    shrink = max(shrink, smallest[0] / rows, smallest[1] / columns)
    if shrink < 1:
        size = round(shrink * columns), round(shrink * rows)
        image = image.resize(size, Image.Resampling.BILINEAR)
    return np.asarray(image)
