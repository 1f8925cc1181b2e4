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
    "jradar-sim-1-mini": "one layout of each family for each split, to try it",
    "jradar-sim-4-test": "a unit of its own in each layout, to test on",
}
