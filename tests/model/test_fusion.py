"""Fusion: what all frames see stays, what one frame doubts others settle."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.model import Model, Tables, fuse, load_model, mixtures, moving_pixels
from jradar.model.grids.view.answers import likeliest_range
from jradar.range_image import (
    ConfidenceTable,
    ImageSpec,
    encode_range,
    project,
    unproject,
)
from jradar.types import PointCloud
from tests.models import CONDITION_SHAPE, changed, tiny_model

VIEW = {"azimuth": (-math.pi / 3, math.pi / 3), "max_range_m": 12.0}
VIEW |= {"elevation": (-math.pi / 9, math.pi / 9)}
FINE, COARSE = ImageSpec(16, 64, **VIEW), ImageSpec(8, 8, **VIEW)
SPEC = changed(load_model("jradar-sim").spec, fine=FINE, coarse=COARSE)
MODEL = Model({}, SPEC, Tables(ConfidenceTable.of((0.0, 1.0), least=0.3)))
STILL = np.eye(4, dtype=np.float32)
UNIT = np.asarray(unproject(jnp.ones(FINE.shape), FINE).xyz)  # directions of pixels
AZIMUTH = np.arctan2(UNIT[:, 1], UNIT[:, 0])[: FINE.width]
WALKER = (slice(4, 12), slice(40, 48))  # pixels


def frame_of(range_m, other_m=None, share=0.0, returned=6.0):
    """A frame that is nearly sure of a range, or of two with shares."""
    both = np.float32([range_m, range_m if other_m is None else other_m])
    code = encode_range(jnp.asarray(both), max_range_m=12.0)
    weight = np.broadcast_to(np.float32([1 - share, share]), (*FINE.shape, 2))
    return RangeMixture(
        jnp.where(both[0] > 0, returned, -30.0),
        jnp.asarray(weight),
        jnp.moveaxis(code, 0, -1),
        jnp.full((*FINE.shape, 2), 2e-3),
    )


def fused(frames, *poses, **options):
    """Frames, newest first, of a radar at these places, by default at rest."""
    poses = np.stack([STILL, *poses, *[STILL] * (len(frames) - 1 - len(poses))])
    stacked = jax.tree.map(lambda *values: jnp.stack(values), *frames)
    return fuse(stacked, jnp.asarray(poses), MODEL, **options)


def moved(x_m):
    """The pose of a radar that stood behind the present one, `x_m` < 0."""
    pose = STILL.copy()
    pose[0, 3] = x_m
    return pose


def wall(x_m):
    """The range image of a wall across the view, at x."""
    return (x_m / UNIT[:, 0]).reshape(FINE.shape).astype("float32")


def test_one_frame_and_three_alike_answer_as_draw_does():
    frame = frame_of(wall(4.0), wall(6.0), share=0.4)
    alone, one = likeliest_range(frame, SPEC.grid), fused([frame])
    np.testing.assert_allclose(one.range_m, alone.range_m, rtol=1e-4)
    np.testing.assert_allclose(one.confidence, alone.confidence, atol=1e-5)
    three = fused([frame, frame, frame])
    # A pixel's centre lies in its own pixel, also after the way there and back.
    np.testing.assert_allclose(three.confidence, one.confidence, atol=1e-3)
    np.testing.assert_allclose(three.range_m, one.range_m, atol=0.02)


def test_a_doubt_of_the_present_frame_is_settled_by_earlier_ones():
    present = frame_of(wall(6.0), wall(4.0), share=0.45)  # the wall is at 4 m
    past = [frame_of(wall(4.0 + step)) for step in (0.3, 0.6)]  # farther behind
    for poses, least, most in (
        ((moved(-0.3), moved(-0.6)), 0.95, 1.0),
        ((STILL, STILL), 0.0, 0.2),  # without the motion nothing agrees
    ):
        found = np.asarray(fused([present, *past], *poses).range_m)
        right = np.abs(found - wall(4.0))[:, 8:-8] < 0.1
        assert least <= right.mean() <= most


def test_a_rotation_moves_the_view_and_what_left_it_counts_no_frame():
    angle = np.deg2rad(20)
    pose = STILL.copy()
    pose[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    here = wall(5.0)
    xyz = np.asarray(unproject(here, FINE).xyz) @ pose[:3, :3]  # in the past frame
    there = project(PointCloud(jnp.asarray(xyz), jnp.ones(len(xyz), bool)), FINE)
    past, present = frame_of(np.asarray(there)), frame_of(here, returned=0.4)
    both, alone = fused([present, past], pose), fused([present])
    gained = np.asarray(both.confidence) - np.asarray(alone.confidence)
    assert np.median(gained[:, np.deg2rad(-35) < AZIMUTH]) > 0.1
    np.testing.assert_allclose(gained[:, np.deg2rad(-42) > AZIMUTH], 0, atol=1e-5)


def test_a_mover_is_kept_from_the_present_frame_and_leaves_no_trail():
    here, before = wall(5.0), wall(5.0)
    trail = (WALKER[0], slice(20, 28))  # it walked to the right
    here[WALKER], before[trail] = 3.0, 3.0
    frames = [frame_of(here), frame_of(before)]
    moving = np.zeros((2, *FINE.shape), bool)
    moving[0][WALKER] = moving[1][trail] = True
    found = fused(frames, moving=jnp.asarray(moving))
    np.testing.assert_allclose(found.range_m, here, rtol=1e-3)
    assert np.asarray(found.confidence)[WALKER].min() > 0.9
    assert np.asarray(fused(frames).confidence)[WALKER].max() < 0.6


def test_a_frame_without_a_pose_is_left_out():
    present, other = frame_of(wall(4.0), returned=0.5), frame_of(wall(7.0))
    alone = fused([present])
    for unknown in (moved(np.nan), STILL * np.nan):
        found = fused([present, other], unknown)
        np.testing.assert_allclose(found.range_m, alone.range_m, rtol=1e-5)
        np.testing.assert_allclose(found.confidence, alone.confidence, rtol=1e-5)


def test_pixels_whose_doppler_differs_from_a_world_at_rest_move():
    frame, cloud = frame_of(wall(5.0)), unproject(wall(5.0), FINE)
    velocity = np.array([1.2, 0.3, 0.0], "float32")
    marked = np.zeros(FINE.shape, bool)
    marked[WALKER] = True
    doppler = -UNIT @ velocity + 1.5 * marked.ravel()
    for unambiguous, speed in ((None, doppler), (2.0, (doppler + 2) % 4 - 2)):
        seen = cloud._replace(velocity=jnp.asarray(speed), power=jnp.ones(len(speed)))
        options = {"unambiguous_mps": unambiguous}
        moving = np.asarray(moving_pixels(frame, seen, velocity, SPEC.grid, **options))
        assert moving[marked].mean() > 0.7 and moving[:, :32].mean() < 0.02
    assert not moving_pixels(frame, seen, velocity * np.nan, SPEC.grid, **options).any()


def test_a_diffusion_model_and_missing_poses_are_refused():
    with pytest.raises(UsageError, match="expected marginal"):
        mixtures(jnp.zeros(CONDITION_SHAPE), tiny_model())
    with pytest.raises(ValueError, match="one for each frame"):
        fused([frame_of(wall(4.0))], STILL)
