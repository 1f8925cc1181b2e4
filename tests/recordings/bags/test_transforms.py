"""The tree of frames: chains of rotations, and a frame that changes its parent."""

from pathlib import Path
from types import SimpleNamespace as Named

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.lidar import transform
from jradar.recordings.bags import transforms
from jradar.recordings.bags.transforms import Frames


def matrix(rotvec, xyz):
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), xyz
    return found


MAST = matrix([0, 0, np.pi / 2], [1.0, 0, 0])  # of the mast in the base
RADAR = matrix([0, np.pi / 2, 0], [0, 2.0, 0])  # of the radar in the mast


def test_a_sensor_lies_where_the_chain_of_its_parents_puts_it():
    frames = Frames({"mast": ("base", MAST), "radar": ("mast", RADAR)}, {})
    point = np.array([[3.0, 0, 0]])
    # Ahead of the radar is below the mast: (0, 2, -3) there, (-1, 0, -3) in the base.
    found = frames.place("radar", "base")
    np.testing.assert_allclose(transform(found, point), [[-1, 0, -3]], atol=1e-12)
    back = frames.place("base", "radar")
    np.testing.assert_allclose(back @ found, np.eye(4), atol=1e-12)
    assert frames.place("radar", "elsewhere") is None


def test_the_newer_parent_of_a_frame_counts(monkeypatch):
    def message(parent, x):
        pose = Named(
            translation=Named(x=x, y=0.0, z=0.0),
            rotation=Named(x=0.0, y=0.0, z=0.0, w=1.0),
        )
        header = Named(frame_id=parent)
        child = Named(header=header, child_frame_id="/radar", transform=pose)
        return Named(transforms=[child])

    sent = [("tf", 1, message("cart", 5.0)), ("tf", 2, message("base", 1.0))]
    monkeypatch.setattr(transforms, "messages", lambda path, topic: sent)
    monkeypatch.setattr(transforms, "decode_message", lambda raw, *_, **__: raw)
    frames = transforms.read_frames(Path("walk.mcap"), ["/tf"])
    parent, place = frames.fixed["radar"]
    assert parent == "base" and place[0, 3] == 1.0 and not frames.moving
