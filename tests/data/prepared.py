"""What tests of preparing, of records and of loading share."""

import dataclasses
import json
from pathlib import Path

import numpy as np

from jradar.data.records import PreparedFrame
from jradar.data.spec import PrepareSpec
from jradar.lidar import LidarSpec
from jradar.radar import Cells, PointSpec
from jradar.types import PointCloud

SPEC = PrepareSpec(
    points=PointSpec(capacity=128, train=(2, 4), false_alarm_rate=1.0),
    block=2,
    lidar=LidarSpec(max_range_m=7.0),
)


def with_points(spec, **changes):
    """The options with other points of the condition."""
    points = dataclasses.replace(spec.points, **changes)
    return dataclasses.replace(spec, points=points)


def digests(folder):
    manifest = json.loads((Path(folder) / "manifest.json").read_text())
    return [s["sha256"] for q in manifest["sequences"] for s in q["shards"]]


def invented_frame(number, sequence="run0", points=64, lidar_points=500):
    """A frame with random clouds in the radar's field of view."""
    rng = np.random.default_rng(number)

    def cloud(count):
        xyz = rng.uniform((1.0, -2.0, -0.5), (9.0, 2.0, 0.5), (count, 3))
        return xyz.astype(np.float32)

    def column():
        return rng.uniform(0.1, 1.0, points).astype(np.float32)

    power, azimuth, elevation = rng.uniform(-1, 1, (3, 8, 16)).astype(np.float32)
    return PreparedFrame(
        sequence=sequence,
        frame=number,
        stamp=100.0 + number,
        lidar_stamp=100.01 + number,
        world_from_radar=np.eye(4) + number,
        cells=Cells(abs(power), azimuth, elevation),
        radar=PointCloud(
            cloud(points), np.arange(points) % 3 > 0, column(), column(), column()
        ),
        lidar_xyz=cloud(lidar_points),
        range_bias_m=0.07,
    )
