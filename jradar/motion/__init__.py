"""Motion: where the radar went, from its Doppler and a sensor of orientation.

    velocities = frame_velocities(recording)
    trajectory = odometry(recording, velocities, rotation="imu")
    write_tum("trajectory.tum", trajectory)

The radar's velocity is that of the radar itself, so it is the radar's position that is
integrated. The lever arm to the base enters once, when its pose becomes the base's.
"""

from jradar.motion.describe import describe_trajectory as describe_trajectory
from jradar.motion.doppler import ego_velocity as ego_velocity
from jradar.motion.following import Follower as Follower
from jradar.motion.gravity import gravity_warnings as gravity_warnings
from jradar.motion.time_offset import (
    propose_offset as propose_offset,
)
from jradar.motion.trajectory import (
    odometry as odometry,
    write_tum as write_tum,
)
from jradar.motion.velocities import (
    Velocities as Velocities,
    frame_velocities as frame_velocities,
)
