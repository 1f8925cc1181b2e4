"""Points to range images and back (sections IV-A and IV-B of the paper).

ImageSpec, pixel_of, pixel_directions   field of view; points to pixels; unit vectors
project, unproject, project_slices      cloud to image of metres, back, and by slices
RangeImage, image_cloud                 ranges with a confidence, and their cloud
condition_image, CHANNELS               cloud to the network's condition
encode_target, decode_target, encode_range, decode_range
                                        metres to the network's values, and back
close_gaps                              fill pixels between a LiDAR's beams
observed_pixels, pattern_reach          pixels that are not between two beams
agreed_range, confident                 what several images agree on; sure pixels alone
near_echo                               pixels near an echo that stands out
surroundings, crowding, count_near      points around the radar's, and how many are near
ConfidenceTable, IDENTITY, fit_confidence, frequency, UNSURE
                                        confidence that holds on new frames
velocity_image                          the radar's velocity at each pixel
TrustTable, fit_trust, condition_features, unlikeness, STRANGE
                                        how unlike training a condition is, 0 to 1
"""

from jradar.range_code import decode_range as decode_range, encode_range as encode_range
from jradar.range_image.agreement import (
    agreed_range as agreed_range,
    confident as confident,
)
from jradar.range_image.codec import (
    CHANNELS as CHANNELS,
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
    ImageSpec as ImageSpec,
    pixel_directions as pixel_directions,
    pixel_of as pixel_of,
)
from jradar.range_image.projection import (
    RangeImage as RangeImage,
    image_cloud as image_cloud,
    project as project,
    project_slices as project_slices,
    unproject as unproject,
)
from jradar.range_image.trust import (
    STRANGE as STRANGE,
    TrustTable as TrustTable,
    condition_features as condition_features,
    fit_trust as fit_trust,
    unlikeness as unlikeness,
)
