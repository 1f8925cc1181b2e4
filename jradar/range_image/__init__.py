"""Points to range images and back (sections IV-A and IV-B of the paper).

ImageSpec                        field of view and pixels, a static argument
project, unproject               cloud to image of metres and back
project_slices, condition_image  one channel per slice of the range axis
encode_target, decode_target     image of metres to network values and back
close_gaps                       fills pixels between a LiDAR's beams
agreed_range                     what several images of one scene agree on
"""

from jradar.range_image.agreement import agreed_range as agreed_range
from jradar.range_image.codec import (
    CHANNELS as CHANNELS,
    close_gaps as close_gaps,
    condition_image as condition_image,
    decode_range as decode_range,
    decode_target as decode_target,
    encode_range as encode_range,
    encode_target as encode_target,
    fill_misses as fill_misses,
)
from jradar.range_image.grid import (
    ImageSpec as ImageSpec,
    pixel_directions as pixel_directions,
    pixel_of as pixel_of,
)
from jradar.range_image.projection import (
    SliceImages as SliceImages,
    project as project,
    project_slices as project_slices,
    unproject as unproject,
)
