"""Published sets: View-of-Delft, TJ4DRadSet, nuScenes, Astyx, DREAM-PCD."""

import numpy as np
import pytest

from jradar.recordings import is_recording, nearest_scan, open_recording
from jradar.recordings.points.frames import describe_points, static_fits
from tests.recordings.points.astyx_writer import write_astyx

RNG = np.random.default_rng(0)
XYZ = RNG.uniform((2, -3, -1), (8, 3, 1), (40, 3)).astype(np.float32)
VELOCITY = RNG.normal(size=40).astype(np.float32)
NUSCENES = (
    *("x y z F 4", "dyn_prop I 1", "id I 2", "rcs vx vy vx_comp vy_comp F 4"),
    *("is_quality_valid ambig_state x_rms y_rms invalid_state pdh0 vx_rms vy_rms I 1",),
)


def test_view_of_delft_has_seven_columns(tmp_path):
    table = np.column_stack(
        [XYZ, RNG.normal(size=40), VELOCITY, VELOCITY, -np.ones(40)]
    )
    for name in ("00001.bin", "00000.bin"):
        table.astype("<f4").tofile(tmp_path / name)
    found = open_recording(tmp_path)
    assert len(found.points) == 2
    cloud = found.points[1]
    np.testing.assert_array_equal(cloud.xyz, XYZ)
    np.testing.assert_array_equal(cloud.velocity, VELOCITY)
    np.testing.assert_allclose(10 * np.log10(cloud.power), table[:, 3], atol=1e-4)


def test_clouds_of_lidars_are_of_neither_set(tmp_path):
    scan = np.column_stack([XYZ, RNG.uniform(size=40)])  # KITTI, also 7 and 8 columns
    np.tile(scan, (14, 1)).astype("<f4").tofile(tmp_path / "000000.bin")
    assert not is_recording(tmp_path)
    samples = RNG.integers(-99, 99, 16 * 7 * 8).astype("<i2")  # tiny, as float32
    samples.tofile(tmp_path / "000000.bin")
    assert not is_recording(tmp_path)


def write_nuscenes(path, valid):
    names, kinds = [], []
    for line in NUSCENES:
        *some, kind, size = line.split()
        names += some
        kinds += [(kind, size)] * len(some)
    table = np.zeros(40, [(n, f"<{k.lower()}{s}") for n, (k, s) in zip(names, kinds)])  # noqa: B905
    for name, column in zip("xy", XYZ.T[:2], strict=True):
        table[name] = column
    away = XYZ[:, :2] / np.linalg.norm(XYZ[:, :2], axis=1, keepdims=True)
    table["vx"], table["vy"] = (away * VELOCITY[:, None]).T
    table["rcs"], table["ambig_state"], table["invalid_state"] = 5.0, 3, ~valid
    head = [
        *("# .PCD v0.7", "VERSION 0.7", f"FIELDS {' '.join(names)}"),
        f"SIZE {' '.join(size for _, size in kinds)}",
        f"TYPE {' '.join(kind for kind, _ in kinds)}",
        *(f"COUNT {' '.join('1' for _ in kinds)}", "WIDTH 40", "HEIGHT 1"),
        *("VIEWPOINT 0 0 0 1 0 0 0", "POINTS 40", "DATA binary", ""),
    ]
    path.write_bytes("\n".join(head).encode() + table.tobytes())


def test_nuscenes_has_radial_velocities_and_states(tmp_path):
    valid = np.arange(40) % 4 > 0
    for k in range(3):
        name = f"n015__RADAR_FRONT__{1_532_402_928_269_133 + 75_000 * k}.pcd"
        write_nuscenes(tmp_path / name, valid)
    found = open_recording(tmp_path)
    np.testing.assert_allclose(np.diff(found.points.stamps), 0.075, atol=1e-6)
    cloud = found.points[0]
    np.testing.assert_allclose(cloud.xyz[:, :2], XYZ[valid, :2])
    np.testing.assert_allclose(cloud.velocity, VELOCITY[valid], rtol=1e-5)
    np.testing.assert_allclose(cloud.power, 10**0.5, rtol=1e-5)
    assert not found.has_elevation


def test_real_radar_on_a_car_at_17_mps(samples):
    found = open_recording(samples / "tj4d")
    assert len(found.points) == 8
    share, speed, ahead = static_fits([*found.points]) or (0, 0, 0)
    assert 0.9 < share < 0.98 and 16 < ahead <= speed < 18


def test_astyx_velocities_are_negative_where_its_own_are_positive(tmp_path):
    path = write_astyx(tmp_path / "walk.npz", [("wall",)])
    (cloud,) = open_recording(path).points
    written = np.load(path)["radar_mm_s"]
    np.testing.assert_allclose(cloud.velocity, -written / 1000, atol=1e-6)


def test_real_pairs_of_radar_and_lidar(samples):
    found = open_recording(samples / "astyx/astyx_0_409.npz")
    sizes = [len(cloud.valid) for cloud in found.points]
    assert (len(sizes), min(sizes), max(sizes)) == (410, 320, 9432)
    assert abs(found.points[7].velocity).max() <= 5.3
    scan = nearest_scan(found, 7)
    assert scan is not None and 4_100 <= len(scan) <= 8_964
    still = [found.points[k] for k in range(0, 410, 10)]
    share, _, ahead = static_fits(still) or (0, 0, 0)
    assert share > 0.25 and ahead > 0  # folded velocities, of a car that drives ahead


def test_real_frames_have_poses_and_a_static_world(samples):
    (path,) = (samples / "dream_pcd_frames").glob("*.npz")
    found = open_recording(path)
    assert len(found.points) == 191 and found.poses is not None
    share, speed, _ = static_fits([*found.points]) or (0, 0, 0)
    assert share > 0.85
    path_m = np.linalg.norm(np.diff(found.poses.xyz, axis=0), axis=1).sum()
    assert path_m == pytest.approx(10.0, abs=0.3)
    assert speed / (path_m / 19) == pytest.approx(1.6, abs=0.1)
    archive = np.load(path)
    world, numbers = archive["points"], archive["frame_ids"]
    rows = world[archive["frame"] == numbers[50], :3]
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # x right, y forward
    from scipy.spatial.transform import Rotation

    pose = Rotation.from_quat(found.poses.quaternion[50]).as_matrix()
    placed = found.points[50].xyz @ pose.T + found.poses.xyz[50]
    np.testing.assert_allclose(placed, rows @ turn.T, atol=1e-4)


def test_the_description_of_points_counts_what_is_there(tmp_path):
    table = np.column_stack(
        [XYZ, VELOCITY, np.linalg.norm(XYZ, axis=1), *np.ones((3, 40))]
    )
    table.astype("<f4").tofile(tmp_path / "1.bin")
    shown = describe_points(open_recording(tmp_path / "1.bin").points)
    assert shown["points a frame"] == "40, 40 to 40" and shown["snr"] == "none"
    low, high = VELOCITY.min(), VELOCITY.max()
    assert shown["velocity (m/s)"] == f"{low:.2f} to {high:.2f}"
