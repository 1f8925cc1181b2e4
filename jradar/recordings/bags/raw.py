"""Raw ADC samples in ROS bags: a message of int16 numbers for each frame.

    xwr_msgs/IQ                 of xwr_ros: header, Int16MultiArray iq, bool complete
    mmWave/data_frame           of iwr_raw_rosnode: an array of int16
    std_msgs/Int16MultiArray

Numbers are in the order of the capture card, [chirp][tx][rx][sample]; `iq_order`
describes I and Q. The radar's description is not in the bag.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int16, Num

from jradar.errors import UsageError
from jradar.radar import RadarSpec
from jradar.recordings.bags.bags import TopicStream, bag_definition, bag_topics
from jradar.recordings.descriptions import find_description
from jradar.recordings.recording import Format, Recording
from jradar.recordings.ti.dca1000 import (
    DESCRIPTION_NAMES,
    bytes_of_frame,
    described_samples,
)
from jradar.recordings.ti.iq_order import cube_of_words

SUFFIXES = (".bag", ".db3", ".mcap")
DEFINITIONS = {  # for bags that do not hold them
    "xwr_msgs/msg/IQ": (
        "std_msgs/Header header\nstd_msgs/Int16MultiArray iq\nbool complete\n"
    ),
    "mmWave/msg/data_frame": "int16[] data\n",
    "std_msgs/msg/Int16MultiArray": "",  # which rosbags knows
}


class RawStream(TopicStream):
    """The frames of one topic as cubes."""

    def __init__(self, path: Path, topic: str, kind: str, radar: RadarSpec, order: str):
        """Read the times of all frames; `order` is that of I and Q."""
        self.radar, self.order = radar, order
        self._text = bag_definition(path, topic) or DEFINITIONS[kind]
        header = "Header" in self._text.partition("====")[0]
        super().__init__(path, topic, kind, sensor="radar", has_header=header)

    def decode(self, index: int) -> Num[np.ndarray, "tx rx chirp sample"]:
        """Return the cube of frame `index`."""
        raw, where = self.message(index), f"{self.path}: message {index} of"
        try:
            store, is_ros1 = _store(self._text, self.kind, self.is_ros1), self.is_ros1
            read = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
            words = _int16_array(read(raw, self.kind))
        except Exception as error:  # a damaged message can raise anything
            raise ValueError(f"{where} {self.topic} is damaged: {error}") from error
        expected = bytes_of_frame(self.radar) // 2
        if len(words) != expected:
            raise ValueError(
                f"{where} {self.topic} holds {len(words):,} numbers, {self.radar.name} "
                f"needs {expected:,} for {self.radar.cube_shape} [tx, rx, chirp, "
                "sample]: does the description belong to another recording?"
            )
        return cube_of_words(words, self.radar, self.order)


def open_raw_bag(
    path: Path | str,
    description: Path | str | None = None,
    *,
    iq_order: str | None = None,
    device: str | None = None,
) -> Recording:
    """Open the radar frames in a bag; options as in `open_dca1000`.

    Raises UsageError for a bag with several topics of samples, and ValueError for a
    damaged bag and for messages that do not hold a frame of the radar.
    """
    path = Path(path)
    description = description or find_description(path, DESCRIPTION_NAMES)
    described = described_samples(path, description, iq_order=iq_order, device=device)
    topics = _raw_topics(path)
    if len(topics) != 1:
        raise UsageError(
            f"{path}: {len(topics)} topics hold raw samples ({', '.join(topics)}), "
            "expected one: leave the others out with `ros2 bag convert` or "
            "`rosbag filter`"
        )
    ((topic, kind),) = topics.items()
    radar, capture, doubts = described
    cubes = RawStream(path, topic, kind, radar, capture.iq_order)
    if not len(cubes):
        raise ValueError(f"{path}: no message is on the topic {topic}")
    cubes[0]
    return Recording(
        name=path.stem,
        path=path,
        radar=capture.radar(radar),
        cubes=cubes,
        iq_order=capture.iq_order,
        notes=(*doubts, f"frames are on the topic {topic}", *cubes.notes),
    )


def holds_samples(path: Path) -> bool:
    """True for a bag with a topic of raw samples; only its index is read."""
    if path.suffix not in SUFFIXES and not (path / "metadata.yaml").is_file():
        return False
    try:
        return bool(_raw_topics(path))
    except (ImportError, OSError, ValueError):
        return False


READER = Format(
    "a ROS bag of raw samples with the radar's .cfg, log or .toml",
    holds_samples,
    open_raw_bag,
    ("description", "iq_order", "device"),
)


def _raw_topics(path: Path) -> dict[str, str]:
    """Return the type of each topic that holds raw samples."""
    topics = bag_topics(path).items()
    return {name: kind for name, (kind, _) in topics if kind in DEFINITIONS}


@functools.cache
def _store(text: str, kind: str, is_ros1: bool) -> Any:
    """Return rosbags' types with that of a message."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    if text and not kind.startswith("std_msgs/"):
        types = get_types_from_msg(text, kind)
        store.register({k: v for k, v in types.items() if k not in store.types})
    return store


def _int16_array(message: Any) -> Int16[np.ndarray, " word"]:
    """Return the array of int16 in a message, or in one of its fields."""
    for value in vars(message).values():
        if isinstance(value, np.ndarray) and value.dtype == np.int16:
            return value
        if hasattr(value, "__msgtype__") and hasattr(value, "data"):
            return _int16_array(value)
    raise ValueError("it holds no array of int16")
