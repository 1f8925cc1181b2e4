"""Writers of frames, which the name of the output chooses.

    out.mcap      MCAP with Foxglove's messages; a crash loses its last second
    out.ros2      ROS 2 bag: sensor_msgs/PointCloud2, sensor_msgs/Image, tf2_msgs;
                  a crash loses its last second
    out.mp4       video from above, complete at the end; also out.gif
    out           folder with a PLY file of each cloud, frame by frame

All have `write(frame)`, `save()` and `close()`. Without `force`, none of them replaces
an MCAP file or a bag, or a file in a folder that no earlier session wrote.
"""

import functools
import shutil
from pathlib import Path
from typing import Protocol, runtime_checkable

from jradar.errors import UsageError
from jradar.outputs.clouds import valid_points, verdict_array, write_npz, write_ply
from jradar.outputs.guard import GuardedFolder
from jradar.outputs.messages import exists
from jradar.outputs.published import CLOUDS, Published


@runtime_checkable
class Writer(Protocol):
    """Takes frames until it is closed."""

    def write(self, frame: Published) -> None:
        """Write or send one frame."""

    def save(self) -> None:
        """Make what was written safe from a crash; call it while no frame waits."""
        ...

    def close(self) -> None:
        """End the file."""


class FolderWriter:
    """`folder/000012/enhanced.ply` and `.npz`, for each frame and cloud."""

    def __init__(self, path: Path, *, force: bool = False):
        """`path` may exist; UsageError if it holds clouds that no session wrote."""
        path.mkdir(parents=True, exist_ok=True)
        self._folder = GuardedFolder(path, "live", force=force)
        names = (f"{name}.{kind}" for name in CLOUDS for kind in ("ply", "npz"))
        found = (there for name in names for there in path.glob(f"[0-9]*/{name}"))
        self._folder.check(there.relative_to(path).as_posix() for there in found)

    def write(self, frame: Published) -> None:
        """Write the clouds of a frame into a folder of its number."""
        files = {}
        for name, cloud in frame.clouds.items():
            place = f"{frame.number:06d}/{name}"
            points = valid_points(cloud)
            notes = frame.verdict if name == "enhanced" else ()
            points |= verdict_array(notes) if notes else {}
            write = functools.partial(write_ply, cloud=cloud, notes=notes)
            files |= {f"{place}.ply": write}
            files[f"{place}.npz"] = functools.partial(write_npz, arrays=points)
        self._folder.put(files)

    def save(self) -> None:
        """Do nothing: every file is safe."""

    def close(self) -> None:
        """Do nothing: every file is closed."""


STREAMED = (".mcap", ".ros2", ".mp4", ".gif")  # all frames in one file or bag
CLOUDS_OF_OTHERS = (".bag", ".db3", ".ply", ".npz", ".pcd")


def open_writer(path: Path | str, *, force: bool = False) -> Writer:
    """Return the writer for an output's name; `force` replaces what is there.

    Raises UsageError for a name of no known kind, and for a file or a bag that exists;
    ImportError that names the extra if a package is missing.
    """
    path = Path(path)
    if path.suffix in CLOUDS_OF_OTHERS:
        raise UsageError(
            f"{path} cannot be written: expected an .mcap file, a .ros2 bag, a video "
            "(.mp4 or .gif), or a folder"
        )
    if path.suffix not in STREAMED:
        if path.is_file():
            raise UsageError(f"{path} is a file, expected the name of a folder")
        return FolderWriter(path, force=force)
    if path.exists() and not force:
        raise exists(path)
    if path.suffix == ".mcap":
        from jradar.outputs.foxglove import FoxgloveWriter as StreamWriter
    elif path.suffix == ".ros2":
        from jradar.outputs.ros2 import BagWriter as StreamWriter
    else:
        from jradar.outputs.video import VideoWriter as StreamWriter
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove(path)
    return StreamWriter(path)


def _remove(path: Path) -> None:
    """Remove an MCAP file or a bag; UsageError for a folder with other files."""
    if not path.is_dir():
        path.unlink(missing_ok=True)
        return
    parts = {"metadata.yaml", "metadata.yaml.tmp", f"{path.name}.mcap"}
    for other in sorted({entry.name for entry in path.iterdir()} - parts):
        raise UsageError(f"{path / other} is not part of a bag: name another output")
    shutil.rmtree(path)
