"""Names that the library, the command line and configs share, each with its help.

    boards       boards and recorded devices
    sensor       RadarSpec: chirp, antennas, and what follows from them
    detectors    CFAR detectors, their window, and its rules
    points       PointSpec: how radar points are detected and located
    models       shipped models
    scenes       families of simulated scenes, and named sets of them

A board, for instance, is one entry of `boards.BOARDS`; `--device` and its help follow.
Nothing here imports JAX, so `--help` is fast.
"""
