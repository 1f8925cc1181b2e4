"""Points to range images and back (sections IV-A and IV-B of the paper).

Pixels
    ImageSpec                       field of view and pixels, a static argument
    pixel_of, pixel_directions      points to pixels; pixels to unit vectors

Projection
    project, unproject              cloud to image of metres, and back
    RangeImage, image_cloud         ranges with a confidence, and their cloud
    project_slices                  one image for each slice of the range axis

Values of the network
    condition_image, CHANNELS       cloud to the network's condition
    encode_target, decode_target    image of metres to the network's values, and back
    encode_range, decode_range      the same for the range alone
    close_gaps                      fill pixels between a LiDAR's beams

    agreed_range                    the range on which several images agree
    confident                       without pixels of little confidence
    ConfidenceTable, IDENTITY, fit_confidence, frequency, UNSURE
                                    confidence that holds on new frames
    velocity_image                  the radar's velocity at each pixel
    TrustTable, fit_trust           what conditions looked like in training
    unlikeness, STRANGE             how unlike them a condition is, 0 to 1; when to warn
"""

from jradar.range_image.agreement import (
    agreed_range as agreed_range,
    confident as confident,
)
from jradar.range_image.codec import (
    CHANNELS as CHANNELS,
    close_gaps as close_gaps,
    condition_image as condition_image,
    decode_range as decode_range,
    decode_target as decode_target,
    encode_range as encode_range,
    encode_target as encode_target,
)
from jradar.range_image.confidence import (
    IDENTITY as IDENTITY,
    UNSURE as UNSURE,
    ConfidenceTable as ConfidenceTable,
    fit_confidence as fit_confidence,
    frequency as frequency,
)
from jradar.range_image.doppler import velocity_image as velocity_image
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
    training_distance as training_distance,
    unlikeness as unlikeness,
)
