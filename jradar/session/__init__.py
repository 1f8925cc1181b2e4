"""The way of a frame, written once: samples to points, condition, image and cloud.

enhance_recording, Enhancement, Frame    a recording's frames, with warnings and times
detect_recording                         their radar points alone
describe_recording                       what a recording holds, and one frame of it
FrameFolder                              the files of frames
Stages                                   the stages of one frame, compiled and timed
of_model, of_radar                       why a model may not suit a radar
load_any_model, AnyModel                 models of either kind by name
"""

from jradar.session.detecting import (
    describe_recording as describe_recording,
    detect_recording as detect_recording,
)
from jradar.session.frames import (
    Enhancement as Enhancement,
    Frame as Frame,
    enhance_recording as enhance_recording,
)
from jradar.session.models import (
    AnyModel as AnyModel,
    load_any_model as load_any_model,
)
from jradar.session.stages import Stages as Stages
from jradar.session.warnings import of_model as of_model, of_radar as of_radar
from jradar.session.writing import FrameFolder as FrameFolder
