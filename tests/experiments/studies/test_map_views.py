"""Views of maps: what the sensors could see of a room, as records."""

import itertools

import numpy as np
import pytest
from scipy.spatial import KDTree

from experiments.studies import map_views
from jradar.data import Records
from jradar.recordings.coloradar.maps import VOXEL_M, MapRun

pytest.importorskip("embreex", reason="the extra `sim` is not installed")
HALF = 30  # voxels, of the room


@pytest.fixture(scope="module")
def room():
    """A room of 9 m with a wall behind a wall, and patches around its middle."""
    across, up = np.mgrid[-HALF:HALF, 0:18].reshape(2, -1)
    walls = []
    for k in (-HALF, HALF, HALF + 6):
        at = np.full_like(across, k)
        walls += [np.stack([at, across, up], -1), np.stack([across, at, up], -1)]
    floor = np.mgrid[-HALF:HALF, -HALF:HALF].reshape(2, -1).T
    floor = np.column_stack([floor, np.zeros(len(floor), int)])
    lidar = np.unique(np.concatenate([*walls, floor]), axis=0).astype(np.int16)
    radar = lidar[::3]

    def bits(voxels):
        inside = np.hypot(*((voxels[:, :2] + 0.5).T)) < 20
        return np.packbits([inside] * 4, axis=1)

    return MapRun("arpg_lab_run1", radar, lidar, bits(radar), bits(lidar))


def test_a_view_has_first_voxels_and_radar_voxels_in_the_field_of_view(room):
    lidar, radar = (KDTree((v + 0.5) * VOXEL_M) for v in (room.lidar, room.radar))
    frames = [*itertools.islice(map_views.views(room, "arpg_lab_00000"), 6)]
    assert len(frames) == 6
    for frame in frames:
        turn, origin = frame.world_from_radar[:3, :3], frame.world_from_radar[:3, 3]
        hits = frame.lidar_xyz @ turn.T + origin
        assert lidar.query(hits)[0].max() < 0.9 * VOXEL_M
        assert np.abs(hits[:, :2]).max() < (HALF + 1.1) * VOXEL_M  # not the wall behind
        points = frame.radar.xyz[frame.radar.valid]
        assert radar.query(points @ turn.T + origin)[0].max() < 1e-4
        azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        assert np.abs(azimuth).max() < 60.01
        assert np.linalg.norm(frame.lidar_xyz, axis=1).max() < 12


@pytest.mark.slow
def test_records_of_views_have_the_splits_of_real_places(room, tmp_path):
    for name in ("arpg_lab_run1", "arpg_lab_run3", "arpg_lab_run4"):
        np.savez(
            tmp_path / f"{name}.npz",
            radar_map=room.radar,
            lidar_map=room.lidar,
            patch=np.arange(4),
            radar_in_patch=room.radar_in_patch,
            lidar_in_patch=room.lidar_in_patch,
        )
    out = tmp_path / "views"
    command = ["--maps", str(tmp_path), "-o", str(out), "--views", "6"]
    assert map_views.main(command) == 0
    sizes = {
        split: len(Records(out, split)) for split in ("train", "validation", "test")
    }
    assert sizes == {"train": 6, "validation": map_views.FEW, "test": map_views.FEW}
    assert map_views.main(command) == 2  # it has records already
