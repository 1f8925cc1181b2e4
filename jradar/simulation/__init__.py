"""A simulated ColoRadar: scenes seen by a LiDAR and a radar, in ColoRadar's own layout.

    FAMILIES                    kinds of procedural scenes, each a function of a seed
    make_setting                a scene and its radars
    radar_frames, lidar_scans   what the sensors measure, in memory
    simulate_sequence           a sequence on disk, in ColoRadar's layout
    simulate_capture            DCA1000 samples, a `.cfg`, and the bag of a Livox
    UnitSpec, draw_unit         a radar as it is built, mounted and disturbed
    SHIFTS, LATER_SHIFTS        what the units of the robustness sets differ in
    shifted_unit, robust_set    the unit of a shift, and the set that holds it
    simulate_set, SETS          named data sets and their versions
    set_sequences               the sequences of a set
    frame_bytes                 size of a frame on disk
    SimulationPlan              a scene or a set to write, its size and its time

Its modules, and what they model:

    scenes/     solids, furniture, building, tunnel, interiors, layouts: geometry
                materials: reflection, transmission, roughness
                scene, trajectory: rays, moving bodies, hand-held motion
    paths/      propagation, reflectors, line_of_sight: speckle, mirrors, ghosts
                bounces, wind, diffuse: two-ray law, echoes between walls, leaves, rooms
                link: antennas, noise, counts of the ADC
    hardware/   hardware, front_end, synthesiser: leakage, channels, filters, I and Q,
                drift, phase noise, chirps that start late
    rig         mounts of the sensors
    units, waveforms
                what differs from unit to unit: boards, chirps, calibration, mounts
    scanner     LiDAR: lost returns, glass
    sequence    streams with their own clocks
    coloradar_writer, capture_writer, sets
                files

Not modelled: diffraction, limbs that swing, wrong stamps (5 ms at walking pace would be
5 mm). Other second bounces are part of the diffuse echoes.
"""

from jradar.simulation.capture_writer import simulate_capture as simulate_capture
from jradar.simulation.plan import SimulationPlan as SimulationPlan
from jradar.simulation.scenes.layouts import FAMILIES as FAMILIES
from jradar.simulation.sequence import (
    frame_bytes as frame_bytes,
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
    UnitSpec as UnitSpec,
    draw_unit as draw_unit,
    shifted_unit as shifted_unit,
)
