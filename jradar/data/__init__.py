"""Files and simulations to frames, and frames to training pairs.

open_cubes                       a recording of ADC cubes, read lazily
random_room, room_frame          simulated rooms seen by radar and LiDAR
make_pairs, batch_indices        pairs of condition and target, drawn by step
write_ply, write_npz             clouds to files
"""

from jradar.data.clouds import (
    valid_points as valid_points,
    write_npz as write_npz,
    write_ply as write_ply,
)
from jradar.data.cubes import Cubes as Cubes, open_cubes as open_cubes
from jradar.data.pairs import (
    Pairs as Pairs,
    batch_indices as batch_indices,
    make_pairs as make_pairs,
)
from jradar.data.scenes import (
    Frame as Frame,
    Room as Room,
    cast_rays as cast_rays,
    random_room as random_room,
    room_frame as room_frame,
    room_scatterers as room_scatterers,
)
