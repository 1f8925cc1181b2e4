"""The pitch of a mount from single echoes: without the bias of velocities, honest."""

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.calibration.mount import LIMITS, Mount
from jradar.calibration.pitch import SYSTEMATIC, SingleEchoes, single_echoes, with_pitch
from jradar.radar import Radar, RadarSpec, Scatterers, simulate_cube
from jradar.recordings import Recording, Stream
from jradar.simulation.scenes.trajectory import pose_at, walk
from tests.calibration.test_mount import CORNERS, OFFSET_S, measured, place

TILT = np.radians(3.0)  # by which mixtures of echoes turn the velocities
PERIOD_MPS, ECHOES = 5.0, 12


def echoes_of(velocities, poses, true, seed, *, outliers=0.1):
    """Echoes that stand still, seen from a true mount: noise, a stretch, outliers."""
    random = np.random.default_rng([seed, 2])
    stamps = velocities.stamps
    path = walk(np.random.default_rng(seed), CORNERS, speed_mps=1, hand_held=True)
    at = stamps - poses.stamps[0] + OFFSET_S
    step = 1e-4
    ahead, back = (pose_at(path, at + side) for side in (step, -step))
    arm = true[:3, 3]
    world = (ahead[0] + ahead[1] @ arm - back[0] - back[1] @ arm) / (2 * step)
    turn = pose_at(path, at)[1] @ true[:3, :3]
    own = np.einsum("tji,tj->ti", turn, world)
    shape = len(stamps), ECHOES
    azimuth = random.uniform(-0.9, 0.9, shape)
    elevation = random.normal(np.radians(-5), np.radians(12), shape)
    toward = np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        -1,
    )
    velocity = -np.einsum("fei,fi->fe", toward, own)
    velocity += 0.01 * random.standard_normal(shape)
    wrong = random.random(shape) < outliers
    velocity[wrong] += random.normal(0, 1, wrong.sum())
    velocity -= PERIOD_MPS * np.round(velocity / PERIOD_MPS)
    noise = np.radians(2) * random.standard_normal(shape)
    known = random.random(shape) < 0.8
    return SingleEchoes(
        stamps=stamps,
        azimuth=azimuth,
        elevation=0.96 * elevation + noise,
        range_m=np.ones(shape),
        velocity=velocity,
        known=known,
        period_mps=PERIOD_MPS,
    )


def biased(seed):
    """A mount by velocities that seem to climb, its echoes and poses, and the truth."""
    path = walk(np.random.default_rng(seed), CORNERS, speed_mps=1, hand_held=True)
    true = place(seed)
    velocities, poses = measured(lambda t: pose_at(path, t), true, seed)
    none = np.zeros((len(velocities.stamps), 3))
    turned = Rotation.from_matrix(true[:3, :3]).as_rotvec()
    deviation = LIMITS / 2
    deviation[1] = np.radians(1.7)
    exact = Mount(true, OFFSET_S, turned, deviation, none[:, 0], none, none, none)
    mount = exact.rotated(Rotation.from_euler("y", TILT).as_matrix(), deviation)
    return mount, echoes_of(velocities, poses, true, seed), poses, true


def pitch_error(mount, true):
    turn = Rotation.from_matrix(true[:3, :3].T @ mount.base_from_radar[:3, :3])
    return turn.as_rotvec()[1]


def test_single_echoes_show_the_pitch_that_velocities_do_not():
    shares = []  # of their stated deviations
    for seed in range(10):
        mount, echoes, poses, true = biased(seed)
        assert abs(pitch_error(mount, true)) > LIMITS[1]
        found = with_pitch(mount, echoes, poses)
        error = pitch_error(found, true)
        assert abs(error) < LIMITS[1] and found.observed[1]
        shares.append(abs(error) / found.deviation[1])
        assert SYSTEMATIC < found.deviation[1] < LIMITS[1]
        others = [0, 2, 3, 4, 5, 6]
        np.testing.assert_array_equal(found.deviation[others], mount.deviation[others])
        turned = Rotation.from_matrix(found.base_from_radar[:3, :3]).as_rotvec()
        np.testing.assert_allclose(found.turned, turned, atol=1e-9)
    assert 0.4 < np.sqrt(np.mean(np.square(shares))) < 1.0  # and not too cautious


def test_few_echoes_and_a_radar_that_looks_aside_change_nothing():
    mount, echoes, poses, _ = biased(3)
    few = echoes._replace(known=echoes.known & (np.arange(ECHOES) == 0))
    few.known[150:] = False
    assert with_pitch(mount, few, poses) is mount
    late = echoes._replace(stamps=echoes.stamps + 100)
    assert with_pitch(mount, late, poses) is mount
    aside = mount.rotated(
        Rotation.from_euler("z", np.pi / 2).as_matrix(), mount.deviation
    )
    assert with_pitch(aside, echoes, poses) is aside


@pytest.mark.parametrize("together", [False, True])
def test_two_echoes_in_one_cell_do_not_count(tmp_path, together):
    """Two echoes at one range and velocity, at different elevations; or one alone."""
    spec = RadarSpec.awr1843(num_samples=64, num_chirps=16)
    place = 4.0 * np.array([[0.94, 0.2, 0.27], [0.94, -0.2, -0.27]], np.float32)
    scatterers = Scatterers(
        xyz=place[: 1 + together],
        velocity=np.zeros(1 + together, np.float32),
        amplitude=np.full(1 + together, 100.0, np.float32),
    )
    cube = simulate_cube(jax.random.key(0), scatterers, spec, noise_power=0.01)
    recording = Recording(
        name="one",
        path=tmp_path,
        radar=Radar(spec),
        cubes=Stream(lambda _: np.asarray(cube), 1, np.zeros(1)),
    )
    found = single_echoes(recording, [0])
    assert found.known.any() != together
    if not together:
        elevation = found.elevation[found.known]
        assert np.degrees(elevation[0]) == pytest.approx(15.5, abs=2)
