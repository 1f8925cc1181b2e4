"""The scores of one cloud by the protocols of several papers; host.

    PROTOCOLS["rald"](found, truth)    the scores of `score_points`, as RaLD has them

`jradar.options.protocols` says in a sentence what each does, and from where. A cloud
that is empty, or that a protocol leaves empty, is scored as in `score_points`.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jradar.evaluation.methods import score_points
from jradar.lidar import shared_field_of_view
from jradar.metrics import f_score_of, kd_tree
from jradar.model.grids.polar import LIDAR, lidar_image
from jradar.options.protocols import PAPER

Points = Float[np.ndarray, "point 3"]
Protocol = Callable[[Points, Points], dict[str, float]]

RALD_VIEW = {
    "azimuth": (-np.pi / 2, np.pi / 2),
    "elevation": (-np.radians(20), np.radians(20)),
    "max_range_m": 15.86,
}
FLAT_LIMIT_M = 0.1  # of Radar-Diffusion's F-score
VOXEL_M = 0.15  # of RMap and UpPoinTr


def radarhd(found: Points, truth: Points) -> dict[str, float]:
    """RadarHD and RadarSFD: centres of polar pixels, in the plane.

    Their code moves these centres by up to 4 cm, onto a Cartesian grid.
    """
    pixels = (LIDAR.xyz[lidar_image(np.asarray(xyz))] for xyz in (found, truth))
    return _halved(score_points(*pixels))


def rald(found: Points, truth: Points) -> dict[str, float]:
    """RaLD: points in its view."""
    seen = (xyz[shared_field_of_view(xyz, **RALD_VIEW)] for xyz in (found, truth))
    return _halved(score_points(*seen))


def radar_diffusion(found: Points, truth: Points) -> dict[str, float]:
    """Radar-Diffusion: from above, with the largest distance, and its own F-score.

    What it calls precision divides the number of right points by these and by the true
    ones that were missed; what it calls recall is the share of right points.
    """
    flat = [np.asarray(xyz) * [1, 1, 0] for xyz in (found, truth)]
    scores = score_points(*flat)
    if not len(found) or not len(truth):
        return scores
    forth, back = (kd_tree(b).query(a)[0] for a, b in (flat, flat[::-1]))
    right, missed = (forth <= FLAT_LIMIT_M).sum(), (back > FLAT_LIMIT_M).sum()
    precision = right / max(right + missed, 1)
    return scores | {
        "modified_hausdorff": float(max(forth.max(), back.max())),
        "f_score_0.1": float(f_score_of(precision, right / len(found))),
    }


def uppointr(found: Points, truth: Points) -> dict[str, float]:
    """UpPoinTr, on RMap's patches: occupied voxels, which are right if they are equal.

    Centres of other voxels are 0.15 m away or more, beyond the 0.1 m of an F-score.
    """
    voxels = (np.unique(np.floor(xyz / VOXEL_M), axis=0) for xyz in (found, truth))
    return _halved(score_points(*((each + 0.5) * VOXEL_M for each in voxels)))


PROTOCOLS: dict[str, Protocol] = {
    PAPER: score_points,
    "radarhd": radarhd,
    "rald": rald,
    "radar-diffusion": radar_diffusion,
    "uppointr": uppointr,
}


def _halved(scores: dict[str, float]) -> dict[str, float]:
    return scores | {"chamfer": scores["chamfer"] / 2}
