"""A simulated ColoRadar: scenes seen by a LiDAR and a radar, in ColoRadar's own layout.

    simulate_sequence("lab", 0, "sim", frames=50)      # a family and a seed, on disk
    simulate_set("jradar-sim-1-mini", "sim")           # or a named set of them
    sources = drawn_sources("jradar-sim-5")            # frames, each of its own place

    scenes/     geometry, layouts, maps to surfaces, materials, rays, hand-held motion
    paths/      echoes, mirrors, ghosts; bounces and clutter of units
    hardware/   channels, leakage, filters, I and Q, phase noise

Diffraction, swinging limbs and wrong stamps (5 ms at walking pace would be 5 mm) are
not modelled. Other second bounces are part of the diffuse echoes.
"""

from jradar.simulation.drawn import (
    drawn_sources as drawn_sources,
)
from jradar.simulation.plan import SimulationPlan as SimulationPlan
from jradar.simulation.sequence import (
    simulate_sequence as simulate_sequence,
)
from jradar.simulation.sets import (
    set_sequences as set_sequences,
    simulate_set as simulate_set,
)
from jradar.simulation.units import (
    draw_unit as draw_unit,
)
