"""RPDNet's training data: maps of power, and the cells that the LiDAR confirms.

A static point in direction d, seen by a radar that moves with velocity v, recedes with

    -d . v

so its range and the platform's motion determine its cell in the range-Doppler map. The
motion is what the Doppler of the frame's echoes says. A cell is labelled if a LiDAR
point falls into it or one of its neighbours, which the main lobe of the windows
reaches, and if its power stands out of the noise. Cheng et al. (2022) also label by
LiDAR but did not publish the code; this one is our own. All of it runs on the host.
"""

import collections
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from experiments.rpdnet.network import map_values
from jradar import data, training
from jradar.evaluation import RecordsInView, records_in_view
from jradar.evaluation.detectors import detected
from jradar.motion import ego_velocity
from jradar.radar import RadarSpec


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
                "static echoes in several directions"
            )
        shapes = {i: data.cells_of(records[i]).power.shape for i in known}
        commonest = collections.Counter(shapes.values()).most_common(1)[0][0]
        self._index = [i for i in known if shapes[i] == commonest]
        self._velocities = velocities[self._index]

    def __len__(self) -> int:
        return len(self._index)

    def __getitem__(self, i: Any) -> Any:
        frame = self._records[self._index[i]]
        power = data.cells_of(frame).power
        label = label_cells(
            frame.lidar_xyz,
            self._velocities[i],
            power,
            self._records.radar_of(frame.sequence),
            min_snr_db=self._min_snr_db,
            range_bias_m=frame.range_bias_m,
        )
        values = map_values(power)
        return training.Batch(values[..., None], label[..., None].astype(np.float32))


def record_velocities(records: data.Records) -> Float[np.ndarray, "frame 3"]:
    """Return the radar's own velocity at each record; NaN where it is unknown."""
    view = records_in_view(records)
    return np.stack([doppler_velocity(records[i], view) for i in range(len(records))])


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
