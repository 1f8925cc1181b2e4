"""The poses of a radar in its last frames, updated frame by frame; host NumPy.

Each step from one frame to the next is the first of these that is known:

    poses       the recorded ones of the base
    imu         the radar's velocity, with the gyroscope's rotation
    velocity    the radar's velocity, without rotation

A step uses nothing that was measured after its newer frame, except for the
interpolation of recorded poses.
"""

import collections
import itertools

import numpy as np
from jaxtyping import Float

from jradar.lidar import interpolate_poses
from jradar.motion.attitude import STILL_MPS, gyro_attitude, gyro_bias
from jradar.recordings import Imu, Recording

LONGEST_STEP_S = 1.0  # that velocities are trusted to bridge
REMEMBERED = 100  # frames, in which the gyroscope's bias is looked for
MARGIN_S = 0.05  # of the IMU's records around a step

Matrix = Float[np.ndarray, "4 4"]
UNKNOWN = np.full((4, 4), np.nan)


class Follower:
    """The places of a recording's radar in its newest frames.

    `steps` counts the steps by their source: "poses", "imu", "velocity" or "none".
    """

    def __init__(self, recording: Recording, *, frames: int):
        """`frames` is how many of the newest are remembered."""
        self.steps: collections.Counter[str] = collections.Counter()
        self._recording = recording
        self._mount = recording.base_from_radar
        self._last = collections.deque[Matrix](maxlen=max(frames - 1, 0))
        self._stamps = collections.deque[float](maxlen=REMEMBERED)
        self._velocities = collections.deque[np.ndarray](maxlen=REMEMBERED)
        self._bias = np.zeros(3)

    def step(
        self, stamp_s: float, velocity: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, "frame 4 4"]:
        """Return the transforms of points from each frame's radar to this one's.

        The frame that began at `stamp_s`, NaN where unknown, comes first, then those
        before it. `velocity` is the radar's own in m/s, along its axes, NaN where
        unknown. A transform is NaN where the motion is unknown. Frames come in order.
        """
        recording = self._recording
        stamp = stamp_s + recording.frame_middle_s
        if not recording.of_points:
            radar = recording.radar.spec
            if radar.num_chirps < 2 or not radar.has_azimuth:
                velocity = np.full(3, np.nan)  # which they do not measure
        self._stamps.append(float(stamp))
        self._velocities.append(np.asarray(velocity, float))
        self._learn_bias()
        if len(self._stamps) > 1:
            self._last.appendleft(self._newest_step())
        chain = itertools.accumulate(self._last, np.matmul, initial=np.eye(4))
        return np.stack([*chain])

    def _newest_step(self) -> Matrix:
        """The transform from the frame before to the newest; NaN if it is unknown."""
        stamps = np.array([*self._stamps][-2:])
        for kind, step in (self._by_poses(stamps), self._by_velocity(stamps)):
            if np.isfinite(step).all():
                self.steps[kind] += 1
                return step
        self.steps["none"] += 1
        return UNKNOWN

    def _by_poses(self, stamps):
        poses = self._recording.poses
        if poses is None or self._mount is None or not np.isfinite(stamps).all():
            return "poses", UNKNOWN
        older, newer = interpolate_poses(poses, stamps) @ self._mount
        return "poses", np.linalg.solve(newer, older)

    def _by_velocity(self, stamps):
        seconds = stamps[1] - stamps[0]
        both = np.stack([*self._velocities][-2:])
        known = np.isfinite(both).all(1)
        if not 0 < seconds <= LONGEST_STEP_S or not known.any():  # NaN, too
            return "velocity", UNKNOWN
        kind, turn = self._turn(stamps)
        step = np.eye(4)
        along_older = [both[0], turn @ both[1]]
        step[:3, :3] = turn
        step[:3, 3] = seconds * np.stack(along_older)[known].mean(0)
        return kind, np.linalg.inv(step)

    def _turn(self, stamps):
        """The source, and the newer radar's orientation along the older one's axes."""
        imu, place = self._recording.imu, self._recording.base_from_imu
        if imu is not None and place is not None and self._mount is not None:
            near = slice(*np.searchsorted(imu.stamps, stamps + [-MARGIN_S, MARGIN_S]))
            records = Imu(*(column[near] for column in imu))
            times = records.stamps
            if len(times) > 1 and times[0] <= stamps[0] and stamps[1] <= times[-1]:
                turn = gyro_attitude(records, stamps, place, bias=self._bias)[1]
                mount = self._mount[:3, :3]
                return "imu", mount.T @ turn @ mount
        return "velocity", np.eye(3)

    def _learn_bias(self):
        """The gyroscope's bias, from the time that the rig stood still."""
        imu, speeds = self._recording.imu, np.linalg.norm([*self._velocities], axis=1)
        if imu is not None and speeds[-1] < STILL_MPS:
            bias = gyro_bias(imu, np.array(self._stamps), speeds)
            self._bias = self._bias if bias is None else bias
