"""Recordings to records of training pairs, and records to batches.

    prepare("coloradar", "records", PrepareSpec())            # a folder of recordings
    frames = Records("records", "train")
    pairs = PairSource(frames, coarse, fine, num_slices=8)    # condition and image
    batch = Batches(pairs, seed=0, batch_size=8)[step]

`prepare_sources` takes any sources, such as simulated ones.
"""

from jradar.data.augment import AugmentSpec as AugmentSpec
from jradar.data.frames import (
    lidar_in_view as lidar_in_view,
    notes_of as notes_of,
    preview as preview,
)
from jradar.data.histories import (
    HistorySpec as HistorySpec,
    fixed_histories as fixed_histories,
    histories as histories,
)
from jradar.data.loading import (
    AugmentedPairs as AugmentedPairs,
    Batch as Batch,
    Batches as Batches,
    Pair as Pair,
    PairSource as PairSource,
    joined as joined,
    lidar_image as lidar_image,
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
    cells_of as cells_of,
    is_records as is_records,
)
from jradar.data.sources import find_sources as find_sources, scene as scene
from jradar.data.spec import PrepareSpec as PrepareSpec
