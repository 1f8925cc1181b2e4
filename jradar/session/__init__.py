"""The way of a frame, written once: samples to points, condition, image and cloud.

enhance_recording, Enhancement, Frame    a recording's frames, with warnings and times
detect_recording, Detection, Detected    their radar points alone
describe_recording                       what a recording holds, and one frame of it
FrameFolder                              the files of frames
Stages, Heard, Stopwatch                 the stages of one frame, compiled and timed
LastFrames, Seen, see, fused             several frames as one
of_radar, blind, of_frames               warnings
"""

from jradar.session.describing import describe_recording as describe_recording
from jradar.session.detecting import (
    Detected as Detected,
    Detection as Detection,
    detect_recording as detect_recording,
)
from jradar.session.frames import (
    Enhancement as Enhancement,
    Frame as Frame,
    enhance_recording as enhance_recording,
)
from jradar.session.fusion import (
    LastFrames as LastFrames,
    Seen as Seen,
    fused as fused,
    see as see,
)
from jradar.session.stages import (
    Heard as Heard,
    Stages as Stages,
    Stopwatch as Stopwatch,
)
from jradar.session.warnings import (
    blind as blind,
    of_frames as of_frames,
    of_radar as of_radar,
)
from jradar.session.writing import FrameFolder as FrameFolder
