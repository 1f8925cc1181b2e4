"""A radar's array and its place: channels, tilt and mount, from ordinary echoes.

calibrate_recording, Calibration    all of it for one recording, which is the strongest
                                    echoes of frames (`snapshots`), to
self_calibrate                      channel factors that explain them
level_tilt                          the tilt, which only rotates the view, from motion
                                    over level ground
mount_from_motion, Mount            the radar's place on its rig, from its velocities
                                    and the rig's poses
with_pitch, single_echoes           the pitch of a mount, by echoes that are single
with_roll, surfaces_of              its roll, by surfaces that a LiDAR saw
"""

from jradar.calibration.level import level_tilt as level_tilt
from jradar.calibration.mount import (
    Mount as Mount,
    mount_from_motion as mount_from_motion,
)
from jradar.calibration.pitch import (
    single_echoes as single_echoes,
    with_pitch as with_pitch,
)
from jradar.calibration.recording import (
    Calibration as Calibration,
    calibrate_recording as calibrate_recording,
)
from jradar.calibration.self_calibration import self_calibrate as self_calibrate
from jradar.calibration.surfaces import (
    surfaces_of as surfaces_of,
    with_roll as with_roll,
)
