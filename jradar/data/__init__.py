"""Recordings to records of training pairs, and records to batches.

find_sources                          the recordings in a folder, and their splits
scene                                 of a sequence of ColoRadar, in the paper's words
PrepareSpec, prepare_frame            options, and one prepared frame
lidar_in_view                         all LiDAR points that were in its view
preview                               one frame with the steps of its preparation
prepare, Records, is_records          folders of prepared frames: write and read
prepare_sources                       the same from any sources, such as simulated ones
PairSource, make_pair, lidar_image    prepared frames to images
Batches                               shuffled batches by step
AugmentSpec, AugmentedPairs           changes of frames at random in training
"""

from jradar.data.augment import AugmentSpec as AugmentSpec
from jradar.data.frames import (
    lidar_in_view as lidar_in_view,
    prepare_frame as prepare_frame,
    preview as preview,
)
from jradar.data.loading import (
    AugmentedPairs as AugmentedPairs,
    Batches as Batches,
    Pair as Pair,
    PairSource as PairSource,
    lidar_image as lidar_image,
    make_pair as make_pair,
    pairs_of as pairs_of,
)
from jradar.data.prepare import (
    describe_manifest as describe_manifest,
    prepare as prepare,
    prepare_sources as prepare_sources,
)
from jradar.data.records import (
    PreparedFrame as PreparedFrame,
    Records as Records,
    is_records as is_records,
)
from jradar.data.sources import find_sources as find_sources, scene as scene
from jradar.data.spec import PrepareSpec as PrepareSpec
