"""The study of edges: where pixels are counted, and what counts as flying."""

import numpy as np

from experiments.studies import edges
from jradar.range_image import ImageSpec, unproject

VIEW = ImageSpec(8, 32)
WALL = np.full(VIEW.shape, 6.0, np.float32)


def test_a_pole_is_thin_a_corner_is_an_edge_and_a_wall_is_interior():
    truth = WALL.copy()
    truth[:, 5:7] = 3.0  # a pole
    truth[:, 20:] = 4.0  # a nearer wall
    truth[3, 1::2] = 0  # missed, which is no edge
    edge, narrow, interior = edges.places(truth)
    assert narrow[:, 5:7][truth[:, 5:7] > 0].all() and narrow[:, 7:].sum() == 0
    seen = truth[0] > 0
    assert np.flatnonzero(edge[0]).tolist() == [3, 4, 7, 8, 18, 19, 20, 21]
    assert (edge | narrow | interior)[0].tolist() == seen.tolist()
    assert not (edges.places(truth)[:, truth == 0]).any()
    assert interior[3, 12] and edges.places(WALL)[2].all()


def test_right_and_flying_points_are_counted():
    xyz = np.asarray(unproject(WALL, VIEW).xyz)
    image = WALL.copy()
    image[0, :4] = 6.1  # right
    image[1, :4] = 6.3  # wrong, but near the wall
    image[2, :4] = 3.0  # flying
    image[3, :4] = 0.0
    counts = edges.counted(image, WALL, xyz, VIEW)
    pixels = WALL.size
    assert counts.pixels.tolist() == [0, 0, pixels]
    assert counts.answered[2] == counts.points == pixels - 4
    assert counts.right[2] == pixels - 12 and counts.flying == 4
    text = edges.table({"one": counts, "two": counts}, 1)
    assert text.count("| one |") == 1 and f"{100 * 4 / (pixels - 4):.1f} |" in text


def test_the_picture_has_a_column_for_each_answer():
    frames = [{"LiDAR": WALL, "one pass": WALL, "one draw": 0 * WALL}] * 2
    assert len(edges.figure(frames, VIEW).axes) == 2 * 2 * 3
