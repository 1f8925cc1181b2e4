"""The steps from a frame to a cloud, written once for recordings and live radars.

    for frame in enhance_recording(recording, model, fuse=3):
        frame.cloud, frame.warnings

`Pipeline` observes a frame, lets the model answer and makes a cloud. It also takes care
of the frames before it, warnings and times. `enhance_recording` and `jradar.stream` use
it.
"""

from jradar.pipeline.detecting import (
    Detected as Detected,
    describe_recording as describe_recording,
    detect_recording as detect_recording,
)
from jradar.pipeline.frames import (
    Enhancement as Enhancement,
    chosen_frames as chosen_frames,
    enhance_recording as enhance_recording,
)
from jradar.pipeline.history import frame_times as frame_times
from jradar.pipeline.pipeline import (
    Frame as Frame,
    Pipeline as Pipeline,
    without_interference as without_interference,
)
from jradar.pipeline.stages import Stages as Stages
from jradar.pipeline.warnings import of_model as of_model
