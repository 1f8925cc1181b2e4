"""A simulated ColoRadar: scenes seen by a LiDAR and a radar, in ColoRadar's own layout.

make_scene, FAMILIES             procedural scenes from a seed
make_setting, radar_frames, lidar_scans    what the sensors see, in memory
simulate_sequence                a sequence in ColoRadar's layout
simulate_capture                 DCA1000 samples, .cfg, and a bag of a Livox
simulate_set, check_set, SETS    the benchmark sets jradar-sim.., with digests
simulate                         the command

What is modelled: materials (materials), speckle, mirrors, corners and first-order
ghosts (echoes), antennas, noise, leakage and the ADC (link, radar), channels that
nobody calibrated (radar), phase noise and chirps that start late (synthesiser), mounts
beside their calibration (rig), hand-held motion (motion), returns lost and glass looked
through (lidar), streams whose frames lie apart in time (sequence). What is not:
diffraction, a second bounce between walls, interference, limbs that swing, stamps that
are wrong (5 ms at walking pace would be 5 mm).
"""

from jradar.simulation.capture_writer import simulate_capture as simulate_capture
from jradar.simulation.command import simulate as simulate
from jradar.simulation.layouts import (
    FAMILIES as FAMILIES,
    make_scene as make_scene,
)
from jradar.simulation.sequence import (
    lidar_scans as lidar_scans,
    make_setting as make_setting,
    radar_frames as radar_frames,
    simulate_sequence as simulate_sequence,
    stream_stamps as stream_stamps,
)
from jradar.simulation.sets import (
    SETS as SETS,
    check_set as check_set,
    set_sequences as set_sequences,
    simulate_set as simulate_set,
)
