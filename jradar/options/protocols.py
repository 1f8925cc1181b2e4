"""Protocols: what papers mean by the distances and F-scores of their tables.

Each has its own scores, so numbers of different protocols cannot stand side by side.
"""

PAPER = "paper"  # Wu et al. 2025, and what jradar prints by default
PROTOCOLS = {
    PAPER: "Chamfer is the sum of both mean distances, MHD the larger median",
    "radarhd": "points up to 0.3 m above and below the radar, as polar pixels of 4 cm "
    "and 0.35 degrees; Chamfer is half the sum, MHD the larger median (Prabhakara et "
    "al. 2023; RadarSFD)",
    "rald": "points within 15.86 m, 90 degrees to each side, 20 up and down; Chamfer "
    "is half the sum; RaLD keeps the ground, as the whole LiDAR in view does (Zhang et "
    "al. 2025)",
    "radar-diffusion": "heights are left out; Chamfer is the sum; MHD is the largest "
    "distance of all; the precision of F 0.1 m divides right points by these and "
    "missed true ones (Zhang et al. 2024, its evaluate.py)",
    "uppointr": "centres of occupied voxels of 0.15 m; Chamfer is half the sum; F 0.1 "
    "m counts equal voxels (UpPoinTr on RMap's patches, Mopidevi et al. 2023)",
}
