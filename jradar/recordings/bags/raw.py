"""Raw ADC samples in ROS bags: a message of int16 numbers for each frame.

    jradar_msgs/RadarFrame      of `jradar record`, see `radar_frames`
    xwr_msgs/IQ                 of xwr_ros: header, Int16MultiArray iq, bool complete
    mmWave/data_frame           of iwr_raw_rosnode: an array of int16
    std_msgs/Int16MultiArray

Numbers are in the order of the capture card, [chirp][tx][rx][sample]; `iq_order`
describes I and Q. Only jradar's own bags describe the radar. If the bag holds exactly
one IMU, it is read, too.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int16, Num

from jradar.errors import UsageError, parsing
from jradar.options.sensor import RadarSpec
from jradar.recordings.bags.bags import (
    IMU,
    TopicStream,
    bag_definition,
    bag_topics,
    is_bag,
    open_imu,
    topic_of,
)
from jradar.recordings.bags.radar_frames import (
    DEFINITION,
    KIND,
    described_radar,
    describes_its_radar,
    lost_bytes,
)
from jradar.recordings.recording import Format, Imu, Recording, loss_notes
from jradar.recordings.ti import lanes
from jradar.recordings.ti.dca1000 import (
    bytes_of_frame,
    checked_samples,
    described_samples,
)
from jradar.recordings.ti.iq_order import cube_of_words

DEFINITIONS = {  # for bags that do not hold them
    KIND: DEFINITION,
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

    A `description` replaces that in the bag. Raises UsageError for a bag with several
    topics of samples, and ValueError for a damaged bag and for messages that do not
    hold a frame of the radar.
    """
    path = Path(path)
    if description is None and describes_its_radar(path):
        if device is not None:
            raise UsageError(
                f"device = {device!r} does not apply to {path}, which describes its "
                "radar: leave it out, or name another description with --radar"
            )
        found = checked_samples(path, path, described_radar(path), iq_order=iq_order)
    else:
        found = described_samples(path, description, iq_order=iq_order, device=device)
    radar, capture, warnings = found
    lanes.refuse(path, radar, capture)
    topic, kind = topic_of(path, None, DEFINITIONS.__contains__, "raw samples")
    text, own = bag_definition(path, topic) or DEFINITIONS[kind], kind == KIND
    cubes = TopicStream(
        path,
        topic,
        _decoder(path, kind, text, radar, capture.iq_order),
        sensor="radar",
        has_header="Header" in text.partition("====")[0],
        extract=partial(lost_bytes, is_ros1=path.suffix == ".bag") if own else None,
    )
    if not len(cubes):
        raise ValueError(f"{path}: no message is on the topic {topic}")
    cubes[0]
    notes = (*warnings, f"frames are on the topic {topic}", *cubes.notes)
    lost = np.array(cubes.extracted, np.int64) if own else None
    if lost is not None:
        notes += loss_notes(lost)
    imu, of_imu = _imu(path)
    return Recording(
        name=path.stem,
        path=path,
        radar=capture.radar(radar),
        cubes=cubes,
        lost_bytes=lost,
        base_from_radar=capture.base_from_radar(),
        iq_order=capture.iq_order,
        imu=imu,
        notes=(*notes, *of_imu),
    )


def _imu(path: Path) -> tuple[Imu | None, tuple[str, ...]]:
    """Return the only IMU of a bag, and notes on it; a damaged one is left out."""
    if [kind for kind, _ in bag_topics(path).values()].count(IMU) != 1:
        return None, ()
    try:
        return open_imu(path)
    except ValueError as error:
        return None, (f"the IMU is left out: {error}",)


def holds_samples(path: Path) -> bool:
    """True for a bag with a topic of raw samples; only its index is read."""
    if not is_bag(path):
        return False
    try:
        return any(kind in DEFINITIONS for kind, _ in bag_topics(path).values())
    except (ImportError, OSError, ValueError):
        return False


READER = Format(
    "a ROS bag of raw samples with the radar's .cfg, log or .toml, or one of `jradar "
    "record`, which describes its radar",
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
