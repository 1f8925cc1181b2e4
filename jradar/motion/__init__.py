"""Motion: where the radar went, from its Doppler and a sensor of orientation.

    ego_velocity                       the radar's own velocity in one frame, and movers
    frame_velocities, Velocities       the radar's own velocity in each frame
    cloud_velocities                   the same from a bag of the radar's clouds
    integrate, Trajectory              velocities and orientation to a trajectory
    odometry                           all of it for one recording, or such a bag
    relative_poses                     between the radar's places in two frames
    Follower                           the same for the last frames, as they come
    propose_offset, TimeOffset         the time between the clocks of radar and LiDAR
    gravity_warnings                   mounts that an IMU contradicts: upside down
    write_tum                          a trajectory as a file
    describe_trajectory                in words and numbers
    position_errors, step_errors       APE and RPE against true poses

The radar's velocity is that of the radar itself, so it is the radar's position that is
integrated. The lever arm to the base enters once, when its pose becomes the base's.
"""

from jradar.motion.describe import describe_trajectory as describe_trajectory
from jradar.motion.doppler import ego_velocity as ego_velocity
from jradar.motion.errors import (
    position_errors as position_errors,
    step_errors as step_errors,
)
from jradar.motion.following import Follower as Follower
from jradar.motion.gravity import gravity_warnings as gravity_warnings
from jradar.motion.time_offset import (
    TimeOffset as TimeOffset,
    propose_offset as propose_offset,
)
from jradar.motion.trajectory import (
    Trajectory as Trajectory,
    integrate as integrate,
    odometry as odometry,
    relative_poses as relative_poses,
    write_tum as write_tum,
)
from jradar.motion.velocities import (
    Velocities as Velocities,
    cloud_velocities as cloud_velocities,
    frame_velocities as frame_velocities,
)
