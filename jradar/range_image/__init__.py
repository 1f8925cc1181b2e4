"""Points to range images and back (sections IV-A and IV-B of the paper).

    view = ImageSpec(height=64, width=64)
    metres = project(cloud, view)                           # [row, column], 0: no point
    condition = condition_image(cloud, view, num_slices=8)  # what the network sees
    cloud = unproject(metres, view)

A `RangeImage` has a confidence for each pixel. `ConfidenceTable` makes of it the share
of such pixels that are right; `TrustTable` says how unlike training a condition is.
"""

from jradar.range_code import decode_range as decode_range, encode_range as encode_range
from jradar.range_image.agreement import (
    agreed_range as agreed_range,
    confident as confident,
)
from jradar.range_image.codec import (
    CHANNELS as CHANNELS,
    OF_HISTORY as OF_HISTORY,
    close_gaps as close_gaps,
    condition_image as condition_image,
    decode_target as decode_target,
    encode_target as encode_target,
    observed_pixels as observed_pixels,
    pattern_reach as pattern_reach,
)
from jradar.range_image.confidence import (
    IDENTITY as IDENTITY,
    UNSURE as UNSURE,
    ConfidenceTable as ConfidenceTable,
    fit_confidence as fit_confidence,
    frequency as frequency,
)
from jradar.range_image.doppler import velocity_image as velocity_image
from jradar.range_image.evidence import (
    count_near as count_near,
    crowding as crowding,
    near_echo as near_echo,
    surroundings as surroundings,
)
from jradar.range_image.grid import (
    VIEW as VIEW,
    ImageSpec as ImageSpec,
    pixel_directions as pixel_directions,
    pixel_of as pixel_of,
)
from jradar.range_image.projection import (
    RangeImage as RangeImage,
    image_cloud as image_cloud,
    project as project,
    unproject as unproject,
)
from jradar.range_image.trust import (
    STRANGE as STRANGE,
    TrustTable as TrustTable,
    condition_features as condition_features,
    fit_trust as fit_trust,
    unlikeness as unlikeness,
)
