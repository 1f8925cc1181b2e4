"""Families of simulated scenes, and named sets of them."""

WRITTEN = (  # a function of `simulation.scenes` builds each
    *("hallways", "mine", "lab", "outdoor", "corridor", "hall"),
    *("home", "warehouse", "forest", "plantroom"),
)
DRAWN = (  # a row of `simulation.scenes.kinds` describes each
    *("room", "atrium", "lobby", "stairwell", "shed", "carpark", "yard", "street"),
    *("open", "tunnel"),
)
FAMILIES = (*WRITTEN, *DRAWN)
SETS = {
    "jradar-sim-1": "one radar unit, to train on",
    "jradar-sim-1-test": "the same, to test on",
    "jradar-sim-1-mini": "one layout of each family for each split, to try it",
    "jradar-sim-2": "a unit of its own for every sequence",
    "jradar-sim-2-mini": "one layout of each family for each split",
    "jradar-sim-3": "the units of jradar-sim-2 with twice as many layouts",
    "jradar-sim-4": "more layouts, and units of the second population",
    "jradar-sim-4-mini": "one layout of each family for each split",
    "jradar-sim-4-test": "units of jradar-sim-4 with ColoRadar's chirps, to test on",
}
