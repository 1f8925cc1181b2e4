"""RPDNet's training data: maps of power, and the cells that the LiDAR confirms.

A static point in direction d, seen by a radar that moves with velocity v, recedes with

    -d . v

so its range and the platform's motion determine its cell in the range-Doppler map. The
motion is that of the poses around a frame; without poses, it follows from the Doppler
of the frame's echoes. A cell is labelled if a LiDAR point falls into it or one of its
neighbours, which the main lobe of the windows reaches, and if its power stands out of
the noise. Cheng et al. (2022) also label by LiDAR but did not publish the code; this
one is our own. All of it runs on the host.
"""

import collections
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from jradar import data, training
from jradar.baselines import map_values
from jradar.evaluation import RecordsInView, records_in_view
from jradar.evaluation.detectors import detected
from jradar.motion import ego_velocity
from jradar.radar import RadarSpec

MAX_GAP_S = 0.3  # between two poses that give a velocity


class LabelledMaps(Sequence):
    """Maps of power and their labels `[doppler, range, 1]`, as `training.Batch`."""

    def __init__(self, records: data.Records, *, min_snr_db: float):
        """Use the frames whose velocity is known, with maps of the commonest size."""
        self._records, self._min_snr_db = records, min_snr_db
        velocities = record_velocities(records)
        known = np.flatnonzero(np.isfinite(velocities).all(-1)).tolist()
        if not known:
            raise ValueError(
                f"{records.folder} has no frame with a known velocity: labels need "
                "recordings with a trajectory, or static echoes in several directions"
            )
        shapes = {i: records[i].cells.power.shape for i in known}
        commonest = collections.Counter(shapes.values()).most_common(1)[0][0]
        self._index = [i for i in known if shapes[i] == commonest]
        self._velocities = velocities[self._index]

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, i: Any) -> Any:
        frame = self._records[self._index[i]]
        label = label_cells(
            frame.lidar_xyz,
            self._velocities[i],
            frame.cells.power,
            self._records.radar_of(frame.sequence),
            min_snr_db=self._min_snr_db,
            range_bias_m=frame.range_bias_m,
        )
        values = map_values(frame.cells.power)
        return training.Batch(values[..., None], label[..., None].astype(np.float32))


def record_velocities(records: data.Records) -> Float[np.ndarray, "frame 3"]:
    """Return the radar's own velocity at each record; NaN where it is unknown.

    Doppler gives that of frames without another pose within 0.3 s.
    """
    stamps, poses = np.zeros(len(records)), np.zeros((len(records), 4, 4))
    for i in range(len(records)):
        frame = records[i]
        stamps[i], poses[i] = frame.stamp, frame.world_from_radar
    names = np.array([name for name, _ in records.where])
    velocities = np.full((len(records), 3), np.nan)
    for name in dict.fromkeys(names):
        mine = names == name
        velocities[mine] = sensor_velocities(stamps[mine], poses[mine])
    view = records_in_view(records)
    for i in np.flatnonzero(np.isnan(velocities).any(-1)):
        velocities[i] = doppler_velocity(records[i], view)
    return velocities


def doppler_velocity(
    prepared: data.PreparedFrame, view: RecordsInView
) -> Float[np.ndarray, " 3"]:
    """Return the radar's own velocity by the Doppler of its echoes; NaN if unknown."""
    radar = view.radar_of(prepared)
    found = ego_velocity(
        jax.random.key(0),
        detected(prepared, view, detector="os", rate=1e-3),
        elevation=False,  # a vertical motion is slow, and would be far off
        unambiguous_mps=radar.max_velocity_mps,
    )
    return np.asarray(found.velocity, float)


def label_cells(
    lidar_xyz: Float[np.ndarray, "point 3"],
    velocity: Float[np.ndarray, " 3"],
    power: Float[np.ndarray, "doppler range"],
    radar: RadarSpec,
    *,
    min_snr_db: float = 3.0,
    range_bias_m: float = 0.0,
) -> Bool[np.ndarray, "doppler range"]:
    """Return the cells at LiDAR points whose power is `min_snr_db` above the median.

    Points, and the radar's own velocity in m/s, are in the radar's frame. Ambiguous
    velocities share a cell; points beyond the largest range have none. The radar
    measures ranges `range_bias_m` too long.
    """
    num_doppler, num_range = power.shape
    distance = np.linalg.norm(lidar_xyz, axis=-1)
    known = distance > 0
    distance, xyz = distance[known], lidar_xyz[known]
    receding = -(xyz @ velocity) / distance
    column = np.rint((distance + range_bias_m) / radar.range_resolution_m).astype(int)
    row = np.rint(receding / radar.velocity_resolution_mps).astype(int)
    row = (row + num_doppler // 2) % num_doppler
    inside = column < num_range
    label = np.zeros(power.shape, bool)
    label[row[inside], column[inside]] = True
    label |= np.roll(label, 1, 0) | np.roll(label, -1, 0)
    label[:, 1:-1] |= label[:, 2:] | label[:, :-2]
    return label & (power > np.median(power) * 10 ** (min_snr_db / 10))


def sensor_velocities(
    stamps: Float[np.ndarray, " frame"],
    world_from_sensor: Float[np.ndarray, "frame 4 4"],
) -> Float[np.ndarray, "frame 3"]:
    """Return the sensor's velocity in its own frame, in m/s, from poses in time order.

    It is the mean of the motion since the frame before and to the frame after; NaN if
    both are more than 0.3 s away or have no pose.
    """
    gap = np.diff(stamps)[:, None]
    steps = np.diff(world_from_sensor[:, :3, 3], axis=0)
    near = (gap > 0) & (gap <= MAX_GAP_S)
    steps = np.where(near, steps / np.where(near, gap, 1.0), np.nan)
    nothing = np.full((1, 3), np.nan)
    both = np.stack([np.r_[nothing, steps], np.r_[steps, nothing]])
    count = np.isfinite(both).sum(0)
    total = np.where(np.isfinite(both), both, 0.0).sum(0)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return np.einsum("nij,ni->nj", world_from_sensor[:, :3, :3], mean)
