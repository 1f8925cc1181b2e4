"""The files of one frame that `points` and `enhance` write into a folder."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jradar.files import remove_leftovers
from jradar.recordings import CLOUD_WRITERS, valid_points, write_npz
from jradar.types import PointCloud

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE = "capture.png"
CLOUDS = ("radar", "enhanced")
WRITTEN = (
    PICTURE,
    *(f"{c}.{kind}" for c in CLOUDS for kind in (*CLOUD_WRITERS, "npz")),
)


def frame_folder(options: argparse.Namespace, frame: int) -> Path:
    """Return the folder of a frame: `--output`, or one inside it with `--frames`."""
    return Path(options.output, f"{frame:06d}" if options.frames else "")


def write_frame(
    folder: Path,
    clouds: dict[str, PointCloud],
    figure: "Figure | None",
    *,
    kind: str,
    arrays: dict[str, Any],
) -> list[str]:
    """Write clouds, those of the last one also as NPZ with `arrays`, and a picture if
    there is one.

    Of the names in WRITTEN, nothing is left of an earlier command: the files in a
    folder belong together. Other files there are not touched. Returns the paths.
    """
    for name in WRITTEN:
        path = folder / name
        remove_leftovers(path)
        if path.is_file() or path.is_symlink():
            path.unlink()
    for name, cloud in clouds.items():
        CLOUD_WRITERS[kind](folder / f"{name}.{kind}", cloud)
    name, cloud = [*clouds.items()][-1]
    write_npz(folder / f"{name}.npz", valid_points(cloud) | arrays)
    names = [*(f"{cloud}.{kind}" for cloud in clouds), f"{name}.npz"]
    if figure is not None:
        from jradar.viz import save_figure  # matplotlib takes half a second

        save_figure(figure, folder / PICTURE)
        names.append(PICTURE)
    return [str(folder / name) for name in names]
