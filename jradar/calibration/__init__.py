"""The channels of an array: their factors and their tilt, from ordinary echoes.

calibrate_recording, Calibration    all of it for one recording, which is the strongest
                                    echoes of frames (`snapshots`), to
self_calibrate                      channel factors that explain them
level_tilt                          the part that only turns the view, from motion over
                                    level ground
"""

from jradar.calibration.level import level_tilt as level_tilt
from jradar.calibration.recording import (
    Calibration as Calibration,
    calibrate_recording as calibrate_recording,
)
from jradar.calibration.self_calibration import self_calibrate as self_calibrate
