"""The roll of a mount from echoes on planes: found, honest, and left where unknown."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.calibration.mount import DESCRIBED, LIMITS, Mount
from jradar.calibration.pitch import SingleEchoes
from jradar.calibration.surfaces import SYSTEMATIC, surfaces_of, with_roll
from jradar.lidar import interpolate_poses
from jradar.motion.scans import to_poses
from jradar.radar import Radar, RadarSpec
from jradar.recordings import Recording, Stream
from tests.calibration.test_mount import place

ROOM = np.array([[-4.0, 4.0], [-3.0, 3.0], [-1.2, 1.5]])  # walls, floor and ceiling
ECHOES, FRAMES = 12, 80
ROLL = np.radians(4.0)


def poses():
    """A walk around the room that sways."""
    time = np.linspace(0, 20, 201)
    matrix = np.tile(np.eye(4), (len(time), 1, 1))
    turns = np.stack([0.05 * np.sin(time), 0.04 * np.cos(1.3 * time), 0.3 * time], -1)
    matrix[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    matrix[:, :3, 3] = np.stack(
        [1.5 * np.sin(0.3 * time), 1.2 * np.cos(0.3 * time), 0.05 * np.sin(time)], -1
    )
    return to_poses(time, matrix)


def seen_from(origin, toward):
    """The distance to the walls of the room."""
    with np.errstate(divide="ignore"):
        ways = (ROOM[None] - origin[:, :, None]) / toward[:, :, None]
    return np.where(ways > 0, ways, np.inf).min((1, 2))


def walls(poses):
    """The surfaces, from scans in every direction by a LiDAR on the base."""
    random = np.random.default_rng(5)
    matrices = interpolate_poses(poses, poses.stamps[:-1:4] + 0.05)
    scans = []
    for matrix in matrices:
        toward = random.normal(size=(4000, 3))
        toward /= np.linalg.norm(toward, axis=1)[:, None]
        origin = np.tile(matrix[:3, 3], (len(toward), 1))
        distance = seen_from(origin, toward @ matrix[:3, :3].T)
        distance += 0.01 * random.standard_normal(len(toward))
        scans.append(np.float32(distance[:, None] * toward))
    radar = Radar(RadarSpec.awr1843())
    return surfaces_of(
        Recording(
            "room",
            ".",
            radar,
            Stream(lambda k: None, 0),
            lidar=Stream(scans.__getitem__, len(scans), poses.stamps[:-1:4]),
            base_from_lidar=np.eye(4),
        ),
        poses,
    )


def echoes_of(true, poses, *, count=ECHOES, ghosts=0.1):
    """Echoes of the walls at a radar, with noise of its angles, and ghosts."""
    random = np.random.default_rng(7)
    stamps = np.linspace(0.5, 19.5, FRAMES)
    shape = FRAMES, count
    azimuth = random.uniform(-0.9, 0.9, shape)
    elevation = random.normal(0, 0.3, shape)
    ground = np.cos(elevation)
    toward = np.stack(
        [ground * np.cos(azimuth), ground * np.sin(azimuth), np.sin(elevation)], -1
    )
    at = interpolate_poses(poses, stamps) @ true
    world = np.einsum("fij,fej->fei", at[:, :3, :3], toward).reshape(-1, 3)
    origin = np.repeat(at[:, :3, 3], count, 0)
    range_m = seen_from(origin, world).reshape(shape)
    range_m += 0.03 * random.standard_normal(shape)
    ghost = random.random(shape) < ghosts
    range_m[ghost] *= random.uniform(0.4, 1.6, ghost.sum())
    return SingleEchoes(
        stamps=stamps,
        azimuth=azimuth + np.radians(0.7) * random.standard_normal(shape),
        elevation=elevation + np.radians(2.0) * random.standard_normal(shape),
        range_m=range_m,
        velocity=np.zeros(shape),
        known=np.ones(shape, bool),
        period_mps=5.0,
    )


def rolled(true):
    """A mount of which the motion showed all but the roll."""
    deviation = LIMITS / 2
    deviation[0] = DESCRIBED[0]
    none = np.zeros((FRAMES, 3))
    exact = Mount(true, 0.0, np.zeros(3), deviation, none[:, 0], none, none, none)
    turn = Rotation.from_euler("x", ROLL).as_matrix()
    return exact.rotated(turn, deviation)


def roll_error(mount, true):
    turn = true[:3, :3].T @ mount.base_from_radar[:3, :3]
    return Rotation.from_matrix(turn).as_rotvec()[0]


@pytest.mark.parametrize("seed", range(3))
def test_echoes_on_walls_show_the_roll(seed):
    walk, true = poses(), place(seed)
    mount = rolled(true)
    assert not mount.observed[0]
    assert roll_error(mount, true) == pytest.approx(ROLL)
    found = with_roll(mount, echoes_of(true, walk), walls(walk), walk)
    assert abs(roll_error(found, true)) < np.radians(0.6)
    assert SYSTEMATIC < found.deviation[0] < LIMITS[0] and found.observed[0]
    np.testing.assert_array_equal(found.deviation[1:], mount.deviation[1:])
    turned = Rotation.from_rotvec(found.turned - mount.turned).as_rotvec()
    assert abs(turned[1:]).max() < 1e-6  # about the radar's x axis alone


def test_few_echoes_and_echoes_of_nothing_leave_the_mount():
    walk, true = poses(), place(0)
    mount, surfaces = rolled(true), walls(walk)
    echoes = echoes_of(true, walk)
    few = echoes._replace(known=echoes.known & (np.arange(FRAMES) < 4)[:, None])
    far = echoes._replace(range_m=echoes.range_m + 20)
    for unusable in (few, far):
        assert with_roll(mount, unusable, surfaces, walk) is mount


def test_a_recording_without_scans_has_no_surfaces():
    radar = Radar(RadarSpec.awr1843())
    recording = Recording("walk", ".", radar, Stream(lambda k: None, 0))
    assert surfaces_of(recording, poses()) is None
