"""A radar's array and its place: channels, tilt and mount, from ordinary echoes.

    found = calibrate_recording(recording, level=True)  # walked over level ground

Of the strongest echoes of frames (`snapshots`), `self_calibrate` finds the channel
factors that explain them, `level_tilt` the part that only rotates the view, and
`mount_from_motion` the radar's place on its rig.
"""

from jradar.calibration.level import level_tilt as level_tilt
from jradar.calibration.mount import (
    mount_from_motion as mount_from_motion,
)
from jradar.calibration.recording import (
    calibrate_recording as calibrate_recording,
)
from jradar.calibration.self_calibration import self_calibrate as self_calibrate
