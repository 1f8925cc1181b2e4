"""A simulated ColoRadar: scenes seen by a LiDAR and a radar, in ColoRadar's own layout.

    FAMILIES                    kinds of procedural scenes, each a function of a seed
    make_setting                a scene and its radars
    radar_frames, lidar_scans   what the sensors measure, in memory
    simulate_sequence           a sequence on disk, in ColoRadar's layout
    draw_unit                   a radar as it is built, mounted and disturbed
    SHIFTS, LATER_SHIFTS, robust_set    what the units of the robustness sets differ in
    simulate_set, set_sequences, SETS   named data sets and their versions
    drawn_sources, DRAWN        sets of training frames, each of a place of its own
    row_sources                 the same for radars with one row of antennas
    SimulationPlan              a scene or a set to write, its size and its time

    scenes/     geometry, layouts, maps to surfaces, materials, rays, hand-held motion
    paths/      echoes, mirrors, ghosts; bounces and clutter of units
    hardware/   channels, leakage, filters, I and Q, phase noise

Not modelled: diffraction, limbs that swing, wrong stamps (5 ms at walking pace would be
5 mm). Other second bounces are part of the diffuse echoes.
"""

from jradar.simulation.drawn import (
    DRAWN as DRAWN,
    drawn_sources as drawn_sources,
    kind_of as kind_of,
    row_sources as row_sources,
)
from jradar.simulation.plan import SimulationPlan as SimulationPlan
from jradar.simulation.scenes.layouts import FAMILIES as FAMILIES
from jradar.simulation.sequence import (
    lidar_scans as lidar_scans,
    make_setting as make_setting,
    radar_frames as radar_frames,
    simulate_sequence as simulate_sequence,
)
from jradar.simulation.sets import (
    SETS as SETS,
    robust_set as robust_set,
    set_sequences as set_sequences,
    simulate_set as simulate_set,
)
from jradar.simulation.units import (
    LATER_SHIFTS as LATER_SHIFTS,
    SHIFTS as SHIFTS,
    draw_unit as draw_unit,
)
