"""Raw ADC samples in ROS bags: a message of int16 numbers for each frame.

    xwr_msgs/IQ                 of xwr_ros: header, Int16MultiArray iq, bool complete
    mmWave/data_frame           of iwr_raw_rosnode: an array of int16
    std_msgs/Int16MultiArray

Numbers are in the order of the capture card, [chirp][tx][rx][sample]; `iq_order`
describes I and Q. The radar's description is not in the bag.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int16, Num

from jradar.errors import parsing
from jradar.radar import RadarSpec
from jradar.recordings.bags.bags import (
    TopicStream,
    bag_definition,
    bag_topics,
    topic_of,
)
from jradar.recordings.recording import Format, Recording
from jradar.recordings.ti.dca1000 import bytes_of_frame, described_samples
from jradar.recordings.ti.iq_order import cube_of_words

SUFFIXES = (".bag", ".db3", ".mcap")
DEFINITIONS = {  # for bags that do not hold them
    "xwr_msgs/msg/IQ": (
        "std_msgs/Header header\nstd_msgs/Int16MultiArray iq\nbool complete\n"
    ),
    "mmWave/msg/data_frame": "int16[] data\n",
    "std_msgs/msg/Int16MultiArray": "",  # which rosbags knows
}


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
    radar, capture, doubts = described_samples(
        path, description, iq_order=iq_order, device=device
    )
    topic, kind = topic_of(path, None, DEFINITIONS.__contains__, "raw samples")
    text = bag_definition(path, topic) or DEFINITIONS[kind]
    cubes = TopicStream(
        path,
        topic,
        _decoder(path, kind, text, radar, capture.iq_order),
        sensor="radar",
        has_header="Header" in text.partition("====")[0],
    )
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
        return any(kind in DEFINITIONS for kind, _ in bag_topics(path).values())
    except (ImportError, OSError, ValueError):
        return False


READER = Format(
    "a ROS bag of raw samples with the radar's .cfg, log or .toml",
    holds_samples,
    open_raw_bag,
    ("description", "iq_order", "device"),
)


def _decoder(
    path: Path, kind: str, text: str, radar: RadarSpec, order: str
) -> Callable[[bytes], Num[np.ndarray, "tx rx chirp sample"]]:
    """Return the function that makes a cube of a message; `text` defines its type."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros1 = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    with parsing(path, f"a bag of {kind}"):
        if text and not kind.startswith("std_msgs/"):
            types = get_types_from_msg(text, kind)
            store.register({k: v for k, v in types.items() if k not in store.types})
    read = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    expected = bytes_of_frame(radar) // 2

    def decode(raw: bytes) -> Num[np.ndarray, "tx rx chirp sample"]:
        words = _int16_array(read(raw, kind))
        if len(words) != expected:
            raise ValueError(
                f"it holds {len(words):,} numbers, {radar.name} needs {expected:,} for "
                f"{radar.cube_shape} [tx, rx, chirp, sample]: does the description "
                "belong to another recording?"
            )
        return cube_of_words(words, radar, order)

    return decode


def _int16_array(message: Any) -> Int16[np.ndarray, " word"]:
    """Return the array of int16 in a message, or in one of its fields."""
    for value in vars(message).values():
        if isinstance(value, np.ndarray) and value.dtype == np.int16:
            return value
        if hasattr(value, "__msgtype__") and hasattr(value, "data"):
            return _int16_array(value)
    raise ValueError("it holds no array of int16")
