"""The writer of MCAP files: what a failed write leaves behind."""

import errno

import pytest

from jradar.recordings.bags.mcap_writer import (
    END_WITHOUT_INDEX,
    McapWriter,
    Schema,
)

BYTES = Schema("std_msgs/msg/String", b"string data")


class FullDisk:
    """A file that takes half of the next bytes, and then no more until it is cut."""

    def __init__(self, file):
        self._file, self.full = file, False

    def write(self, data):
        """Write half, or nothing."""
        if not self.full:
            self.full = True
            return self._file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    def truncate(self, size):
        """Cut the file, and make room."""
        self._file.truncate(size)
        self.write = self._file.write

    def __getattr__(self, name):
        return getattr(self._file, name)


def test_a_chunk_that_does_not_fit_is_cut_off_and_the_file_ends(tmp_path):
    path = tmp_path / "walk.mcap"
    writer = McapWriter(path)
    writer.add("/a", BYTES)
    writer.write("/a", 1, b"first")
    writer.flush()
    before = path.read_bytes()
    writer._file._file = FullDisk(writer._file._file)
    writer.write("/a", 2, b"second" * 100)
    with pytest.raises(OSError, match="walk.mcap cannot be written .*disk full"):
        writer.flush()
    writer.close()
    assert path.read_bytes() == before + b"".join(END_WITHOUT_INDEX)
