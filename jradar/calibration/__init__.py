"""The channels of an array: their factors and their tilt, from ordinary echoes.

calibrate_recording, Calibration    all of it for one recording
strong_snapshots, Snapshots         the strongest echoes of frames, per virtual antenna
self_calibrate, SelfCalibration     channel factors that explain them
channel_response, explain, Explained    how well factors explain snapshots
without_tilt                        factors without the part that only turns the view
level_tilt, untilted, Tilt          that part, from motion over level ground
"""

from jradar.calibration.level import (
    Tilt as Tilt,
    level_tilt as level_tilt,
    untilted as untilted,
)
from jradar.calibration.recording import (
    Calibration as Calibration,
    calibrate_recording as calibrate_recording,
)
from jradar.calibration.self_calibration import (
    Explained as Explained,
    SelfCalibration as SelfCalibration,
    channel_response as channel_response,
    explain as explain,
    self_calibrate as self_calibrate,
    without_tilt as without_tilt,
)
from jradar.calibration.snapshots import (
    Snapshots as Snapshots,
    strong_snapshots as strong_snapshots,
)
