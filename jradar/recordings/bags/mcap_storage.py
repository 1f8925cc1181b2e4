"""MCAP files of ROS 2 messages, whole or cut off, for the readers of rosbags."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import parse_qos

from jradar.files import open_file
from jradar.recordings.bags.mcap_files import McapFile, mcap_profile

FORMATS = {
    "ros2msg": MessageDefinitionFormat.MSG,
    "ros2idl": MessageDefinitionFormat.IDL,
    "omgidl": MessageDefinitionFormat.IDL,
}
QOS = "offered_qos_profiles"


class McapStorage:
    """One file, with the methods that rosbags calls on a storage."""

    def __init__(self, path: Path):
        self.path = path
        self.connections: list[Connection] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """What could not be read so far."""
        return self._file.notes

    def open(self) -> None:
        """Read the index, or scan the file; ValueError without whole messages."""
        profile = mcap_profile(self.path)
        if profile != "ros2":
            why = "Profile is not ros2" if profile is not None else "not an MCAP file"
            raise ValueError(why)
        self._file = McapFile(open_file(self.path), self.path.name)
        self.close = self._file.close
        self.connections = [self._connection(c) for c in self._file.channels.values()]

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time and bytes of messages in the order of their times."""
        chosen = {connection.id: connection for connection in connections}
        for message in self._file.messages(chosen, start, stop):
            yield chosen[message.channel_id], message.log_time, message.data

    def _connection(self, channel: Any) -> Connection:
        schema = self._file.schemas.get(channel.schema_id)
        defined = FORMATS.get(schema.encoding) if schema else None
        text = schema.data.decode() if schema and defined else ""
        return Connection(
            channel.id,
            channel.topic,
            schema.name if schema else "__schemaless__",
            MessageDefinition(defined or MessageDefinitionFormat.NONE, text),
            "",
            self._file.counts.get(channel.id, 0),
            ConnectionExtRosbag2(
                channel.message_encoding, parse_qos(channel.metadata.get(QOS, ""))
            ),
            self,
        )


class WholeMcapStorage(McapStorage):
    """One file of a folder, which must hold all messages that the metadata counts."""

    def open(self) -> None:
        """Read the index; ValueError for a file that was cut off."""
        super().open()
        self._refuse_losses()

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield as the base does; ValueError for a damaged chunk."""
        yield from super().messages(connections, start, stop)
        self._refuse_losses()

    def _refuse_losses(self) -> None:
        if self.notes:
            raise ValueError(self.notes[0])
