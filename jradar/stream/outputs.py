"""Writers of views, chosen by the name of the output.

    out.mcap      MCAP with Foxglove's messages; a crash loses its last second
    out.ros2      ROS 2 bag: sensor_msgs/PointCloud2, sensor_msgs/Image, tf2_msgs;
                  a crash loses its last second
    out           folder with a PLY file of each cloud, frame by frame

All have `write(view)`, `save()` and `close()`. An MCAP file or a bag is never
overwritten unless it is asked for, and neither is a file in a folder that was not
written there before.
"""

import contextlib
import functools
import importlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

from jradar.errors import UsageError
from jradar.recordings import valid_points, write_npz, write_ply
from jradar.results import Results
from jradar.stream.views import CLOUDS, View


@runtime_checkable
class Writer(Protocol):
    """Takes views until it is closed."""

    def write(self, view: View) -> None:
        """Write or send one frame."""
        ...

    def save(self) -> None:
        """Make safe from a crash what was written; call it while nothing is written."""
        ...

    def close(self) -> None:
        """End the file."""
        ...


class FolderWriter:
    """`folder/000012/enhanced.ply` and `.npz`, for each frame and cloud."""

    def __init__(self, path: Path, *, force: bool = False):
        """`path` may exist; UsageError if it holds clouds that are not of a session."""
        path.mkdir(parents=True, exist_ok=True)
        self._results = Results(path, "live", force=force)
        names = (f"{name}.{kind}" for name in CLOUDS for kind in ("ply", "npz"))
        found = (there for name in names for there in path.glob(f"[0-9]*/{name}"))
        self._results.check(there.relative_to(path).as_posix() for there in found)

    def write(self, view: View) -> None:
        """Write the clouds of a frame into a folder of its number."""
        files = {}
        for name, cloud in view.clouds.items():
            place = f"{view.number:06d}/{name}"
            points = valid_points(cloud)
            files[f"{place}.ply"] = functools.partial(write_ply, cloud=cloud)
            files[f"{place}.npz"] = functools.partial(write_npz, arrays=points)
        self._results.put(files)

    def save(self) -> None:
        """Every file is safe."""

    def close(self) -> None:
        """Nothing is left to do."""


class Output(NamedTuple):
    """One kind of output."""

    name: str  # in messages
    matches: Callable[[Path], bool]
    open: Callable[..., Writer]


def _lazy(module: str, name: str) -> Callable[..., Writer]:
    """Return a function that opens a writer of a module with optional packages."""

    def open_writer(path: Path, *, force: bool) -> Writer:
        if force:
            _remove(path)
        return getattr(importlib.import_module(f"jradar.stream.{module}"), name)(path)

    return open_writer


OUTPUTS = (
    Output(
        "a file .mcap",
        lambda path: path.suffix == ".mcap",
        _lazy("foxglove_writers", "McapWriter"),
    ),
    Output(
        "a ROS 2 bag, a folder .ros2",
        lambda path: path.suffix == ".ros2",
        _lazy("bag_writer", "BagWriter"),
    ),
    Output(
        "a folder",
        lambda path: path.suffix not in (".bag", ".db3", ".ply", ".npz", ".pcd"),
        FolderWriter,
    ),
)
STREAMED = OUTPUTS[:2]  # one file or bag for all frames


def is_streamed(path: Path | str) -> bool:
    """True for the name of an output that holds all frames in one file or bag."""
    return any(output.matches(Path(path)) for output in STREAMED)


def open_writer(path: Path | str, *, force: bool = False) -> Writer:
    """Return the writer for an output's name; `force` replaces what is there.

    Raises UsageError for a name of no known kind, and for a file or a bag that exists;
    ImportError that names the extra if a package is missing.
    """
    path = Path(path)
    output = next((kind for kind in OUTPUTS if kind.matches(path)), None)
    if output is None:
        names = ", ".join(kind.name for kind in OUTPUTS)
        raise UsageError(f"{path} cannot be written: expected {names}")
    if is_streamed(path) and path.exists() and not force:
        raise exists(path)
    if not is_streamed(path) and path.is_file():
        raise UsageError(f"{path} is a file, expected the name of a folder")
    path.parent.mkdir(parents=True, exist_ok=True)
    return output.open(path, force=force)


def exists(path: Path) -> UsageError:
    """Return the error for a file or bag that exists."""
    return UsageError(
        f"{path} exists and is not overwritten: name another output, or add --force"
    )


def _remove(path: Path) -> None:
    """Remove an MCAP file or a bag; UsageError for a folder with other files."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    parts = {"metadata.yaml", "metadata.yaml.tmp", f"{path.name}.mcap"}
    for other in sorted({entry.name for entry in path.iterdir()} - parts):
        raise UsageError(f"{path / other} is not part of a bag: name another output")
    shutil.rmtree(path)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise OSError with the file's name for errors of the packages that write it."""
    try:
        yield
    except (RuntimeError, OSError) as error:
        reason = " ".join(str(error).split())
        raise OSError(
            f"{path} cannot be written ({reason}): is the disk full?"
        ) from error


def load(package: str, extra: str, what: str) -> Any:
    """Import an optional package; ImportError that names its extra."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(
            f"{what} needs {package}: pip install 'jradar[{extra}]'"
        ) from error
