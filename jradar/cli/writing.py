"""The files of a frame that `points` and `enhance` write."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jradar.cli.paths import is_streamed
from jradar.errors import UsageError
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


def check_flat(options: argparse.Namespace) -> None:
    """Raise UsageError where `--flat` would mix clouds, or cannot do what is asked."""
    if not options.flat:
        return
    if is_streamed(options.output):
        raise UsageError(f"--flat writes a folder, and {options.output} is one file")
    if getattr(options, "picture", None):
        raise UsageError("--flat writes clouds alone: leave out --flat or --picture")
    for name in CLOUDS:
        folder = Path(options.output, name)
        if folder.is_dir() and any(folder.iterdir()):
            raise UsageError(
                f"{folder} is not empty, and tools read all clouds in a folder: name "
                "another output"
            )


def write_frame(
    options: argparse.Namespace,
    frame: int,
    clouds: dict[str, PointCloud],
    figure: "Callable[[], Figure] | None" = None,
    *,
    arrays: dict[str, Any],
) -> list[str]:
    """Write what the options ask for of one frame; returns the paths.

    With `--flat`, these are the clouds alone, each in the folder of its kind. Otherwise
    they go into the output or, with `--frames`, into a folder of the frame in it: the
    clouds, the last one also as NPZ with `arrays`, and the picture if there is one.
    """
    if options.flat:
        paths = [
            Path(options.output, name, f"{frame:06d}.{options.format}")
            for name in clouds
        ]
        for path, cloud in zip(paths, clouds.values(), strict=True):
            CLOUD_WRITERS[options.format](path, cloud)
        return [*map(str, paths)]
    folder = Path(options.output, f"{frame:06d}" if options.frames else "")
    return _write_folder(folder, clouds, figure, kind=options.format, arrays=arrays)


def _write_folder(folder: Path, clouds, figure, *, kind: str, arrays) -> list[str]:
    """Write the files of a frame into its folder.

    Of the names in WRITTEN, nothing is left of an earlier command: the files in a
    folder belong together. Other files there are not touched.
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

        save_figure(figure(), folder / PICTURE)
        names.append(PICTURE)
    return [str(folder / name) for name in names]
