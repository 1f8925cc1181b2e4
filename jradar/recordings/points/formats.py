"""The readers of points; the first that matches a path reads it."""

from jradar.recordings.points import (
    astyx,
    bags,
    binary,
    dream_pcd,
    nuscenes,
    tables,
    ti_serial,
)

READERS = (
    *(bags.READER, ti_serial.READER, nuscenes.READER, binary.READER),
    *(astyx.READER, dream_pcd.READER, tables.READER),
)
