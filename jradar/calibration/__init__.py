"""A radar's array and its place: channels, tilt and mount, from ordinary echoes.

calibrate_recording, Calibration    all of it for one recording, which is the strongest
                                    echoes of frames (`snapshots`), to
self_calibrate                      channel factors that explain them
level_tilt                          the part that only turns the view, from motion over
                                    level ground
mount_from_motion, Mount            the radar's place on its rig, from its velocities
                                    and the rig's poses
"""

from jradar.calibration.level import level_tilt as level_tilt
from jradar.calibration.mount import (
    Mount as Mount,
    mount_from_motion as mount_from_motion,
)
from jradar.calibration.recording import (
    Calibration as Calibration,
    calibrate_recording as calibrate_recording,
)
from jradar.calibration.self_calibration import self_calibrate as self_calibrate
