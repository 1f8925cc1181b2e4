"""The readers of rosbags, with limits on what they unpack.

rosbags unpacks chunks, messages and files without a limit. These readers are
subclasses, so that rosbags stays as it is for other code in the same program.
`McapStorage` reads MCAP files, also those in the folder of a bag.
"""

import functools
from collections.abc import Collection, Generator, Mapping
from pathlib import Path
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.rosbag1.reader import decompressors
from rosbags.rosbag2.reader import DirectoryReader

from jradar.recordings.bags.mcap_storage import McapStorage, WholeMcapStorage
from jradar.recordings.bags.unpacking import check_file, unpack


class Ros1Reader(rosbag1.Reader):
    """A bag of ROS 1."""

    def read_chunk(self) -> Any:
        """Return the place of a chunk, and the function that unpacks it."""
        chunk = super().read_chunk()
        (name,) = (n for n, how in decompressors.items() if how is chunk.decompressor)
        return chunk._replace(decompressor=functools.partial(unpack, name))


class FolderReader(DirectoryReader):
    """A folder of ROS 2 with metadata.yaml."""

    STORAGE_PLUGINS: Mapping[str, Any] = {
        **DirectoryReader.STORAGE_PLUGINS,
        "mcap": WholeMcapStorage,
    }
    _packed = False  # True if each message is compressed

    def open(self) -> None:
        """Read the metadata; ValueError for a file that unpacks to too much."""
        for file in Path(str(self.path)).iterdir():
            if file.is_file():
                check_file(file)
        super().open()
        self._packed = self.metadata.compression_mode == "message"
        self.metadata = self.metadata._replace(compression_mode=None)

    def messages(
        self,
        connections: Collection[Any],
        start: int | None = None,
        stop: int | None = None,
    ) -> Generator[tuple[Any, int, bytes], None, None]:
        """Yield connection, time and bytes of messages."""
        for connection, time, raw in super().messages(connections, start, stop):
            yield connection, time, unpack("zstd", raw) if self._packed else raw


class Ros2Reader(rosbag2.Reader):
    """A folder of ROS 2, or a single file."""

    STORAGE_PLUGINS: Mapping[str, Any] = {
        **rosbag2.Reader.STORAGE_PLUGINS,
        "dir": FolderReader,
        ".mcap": McapStorage,
    }


def open_reader(path: Path) -> Ros1Reader | Ros2Reader:
    """Return the open reader of a bag."""
    reader = Ros1Reader(path) if path.suffix == ".bag" else Ros2Reader(path)
    reader.open()
    return reader
