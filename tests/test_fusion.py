"""Fusion: what all frames see stays, what one frame doubts others settle."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.model import Model, fuse, load_model, mixtures, moving_pixels
from jradar.model.methods import likeliest_range
from jradar.range_image import (
    ConfidenceTable,
    ImageSpec,
    encode_range,
    project,
    unproject,
)
from jradar.types import PointCloud

VIEW = {
    "azimuth": (-math.pi / 3, math.pi / 3),
    "elevation": (-math.pi / 9, math.pi / 9),
    "max_range_m": 12.0,
}
FINE = ImageSpec(16, 64, **VIEW)
SPEC = dataclasses.replace(
    load_model("jradar-sim").spec,
    fine=FINE,
    coarse=ImageSpec(8, 8, **VIEW),
)
MODEL = Model({}, SPEC, confidence=ConfidenceTable.of((0.0, 1.0), least=0.3))
STILL = np.eye(4, dtype=np.float32)


def frame_of(range_m, other_m=None, share=0.0, returned=6.0):
    """A frame that is nearly sure of a range, or of two with shares."""
    ranges = jnp.asarray(range_m, jnp.float32)
    second = ranges if other_m is None else jnp.asarray(other_m, jnp.float32)
    code = [encode_range(r, max_range_m=12.0) for r in (ranges, second)]
    weight = jnp.broadcast_to(jnp.asarray([1 - share, share]), (*ranges.shape, 2))
    return RangeMixture(
        jnp.where(ranges > 0, returned, -30.0),
        weight,
        jnp.stack(code, -1),
        jnp.full((*ranges.shape, 2), 2e-3),
    )


def stack(*frames):
    return jax.tree.map(lambda *values: jnp.stack(values), *frames)


def poses(*shifts):
    found = np.tile(STILL, (len(shifts), 1, 1))
    found[:, :3, 3] = shifts
    return jnp.asarray(found)


def wall(x_m):
    """The range image of a wall across the view, at x."""
    unit = np.asarray(unproject(jnp.ones(FINE.shape), FINE).xyz)
    return jnp.asarray((x_m / unit[:, 0]).reshape(FINE.shape), jnp.float32)


def test_one_frame_answers_as_draw_does():
    frame = frame_of(wall(4.0), wall(6.0), share=0.4)
    one = fuse(stack(frame), poses((0, 0, 0)), MODEL)
    alone = likeliest_range(frame, SPEC)
    np.testing.assert_allclose(one.range_m, alone.range_m, rtol=1e-4)
    np.testing.assert_allclose(one.confidence, alone.confidence, atol=1e-5)


def test_a_doubt_of_the_present_frame_is_settled_by_earlier_ones():
    present = frame_of(wall(6.0), wall(4.0), share=0.45)  # the wall is at 4 m
    past = [frame_of(wall(4.0 + step)) for step in (0.3, 0.6)]  # farther behind
    found = fuse(
        stack(present, *past), poses((0, 0, 0), (-0.3, 0, 0), (-0.6, 0, 0)), MODEL
    )
    truth = np.asarray(wall(4.0))
    middle = np.abs(np.asarray(found.range_m) - truth)[:, 8:-8]
    assert np.mean(middle < 0.1) > 0.95
    still = fuse(stack(present, *past), poses(*[(0, 0, 0)] * 3), MODEL)
    wrong = np.abs(np.asarray(still.range_m) - truth)[:, 8:-8]
    assert np.mean(wrong < 0.1) < 0.2  # without the motion nothing agrees


def test_a_turn_moves_the_view_and_what_left_it_counts_no_frame():
    turn = np.deg2rad(20)
    pose = STILL.copy()
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    here = wall(5.0)
    xyz = np.asarray(unproject(here, FINE).xyz) @ pose[:3, :3]  # in the past frame
    there = project(PointCloud(jnp.asarray(xyz), jnp.ones(len(xyz), bool)), FINE)
    past, present = frame_of(there), frame_of(here, returned=0.4)
    both = jnp.stack([jnp.asarray(STILL), jnp.asarray(pose)])
    found = fuse(stack(present, past), both, MODEL)
    alone = fuse(stack(present), poses((0, 0, 0)), MODEL)
    gained = np.asarray(found.confidence - alone.confidence)
    seen = np.asarray(pixel_azimuths()) > np.deg2rad(-35)
    assert np.median(gained[:, seen]) > 0.1
    unseen = np.asarray(pixel_azimuths()) < np.deg2rad(-42)
    np.testing.assert_allclose(gained[:, unseen], 0, atol=1e-5)


def pixel_azimuths():
    xyz = np.asarray(unproject(jnp.ones(FINE.shape), FINE).xyz)
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0]).reshape(FINE.shape)
    return azimuth[0]


def test_a_mover_is_kept_from_the_present_frame_and_leaves_no_trail():
    here = np.asarray(wall(5.0)).copy()
    before = here.copy()
    here[4:12, 40:48], before[4:12, 20:28] = 3.0, 3.0  # it walked to the right
    frames = stack(frame_of(here), frame_of(before))
    moving = np.zeros((2, *FINE.shape), bool)
    moving[0, 4:12, 40:48] = moving[1, 4:12, 20:28] = True
    found = fuse(frames, poses(*[(0, 0, 0)] * 2), MODEL, moving=jnp.asarray(moving))
    np.testing.assert_allclose(found.range_m, here, rtol=1e-3)
    assert np.asarray(found.confidence)[4:12, 40:48].min() > 0.9
    blind = fuse(frames, poses(*[(0, 0, 0)] * 2), MODEL)
    assert np.asarray(blind.confidence)[4:12, 40:48].max() < 0.6


def test_three_frames_of_a_radar_that_stands_still_are_as_sure_as_one():
    frame = frame_of(wall(4.0), wall(6.0), share=0.4)
    one = fuse(stack(frame), poses((0, 0, 0)), MODEL)
    three = fuse(stack(frame, frame, frame), poses(*[(0, 0, 0)] * 3), MODEL)
    # A pixel's centre lies in its own pixel, also after the way there and back.
    np.testing.assert_allclose(three.confidence, one.confidence, atol=1e-3)
    np.testing.assert_allclose(three.range_m, one.range_m, atol=0.02)


def test_a_frame_without_a_pose_is_left_out():
    present, other = frame_of(wall(4.0), returned=0.5), frame_of(wall(7.0))
    alone = fuse(stack(present), poses((0, 0, 0)), MODEL)
    unknown = poses((0, 0, 0), (np.nan, 0, 0))
    for pose in (unknown, unknown.at[1].set(np.nan)):
        found = fuse(stack(present, other), pose, MODEL)
        np.testing.assert_allclose(found.range_m, alone.range_m, rtol=1e-5)
        np.testing.assert_allclose(found.confidence, alone.confidence, rtol=1e-5)


def test_pixels_whose_doppler_differs_from_a_world_at_rest_move():
    frame = frame_of(wall(5.0))
    cloud = unproject(wall(5.0), FINE)
    velocity = jnp.array([1.2, 0.3, 0.0])
    away = cloud.xyz / jnp.linalg.norm(cloud.xyz, axis=1)[:, None]
    walker = jnp.arange(len(cloud.xyz)).reshape(FINE.shape)[4:12, 40:48].ravel()
    doppler = (-away @ velocity).at[walker].add(1.5)
    for unambiguous, speed in ((None, doppler), (2.0, (doppler + 2) % 4 - 2)):
        moving = moving_pixels(
            frame,
            cloud._replace(velocity=speed, power=jnp.ones(len(speed))),
            velocity,
            SPEC,
            unambiguous_mps=unambiguous,
        )
        marked = np.zeros(FINE.shape, bool)
        marked[4:12, 40:48] = True
        assert np.mean(np.asarray(moving)[marked]) > 0.7
        assert np.mean(np.asarray(moving)[:, :32]) < 0.02
    unknown = cloud._replace(velocity=doppler, power=jnp.ones(len(doppler)))
    assert not moving_pixels(frame, unknown, velocity * jnp.nan, SPEC).any()


def test_a_diffusion_model_and_missing_poses_are_refused():
    with pytest.raises(UsageError, match="expected 'marginal'"):
        mixtures(jnp.zeros((64, 64, 24)), load_model("jradar-sim-diffusion"))
    frame = frame_of(wall(4.0))
    with pytest.raises(ValueError, match="one for each frame"):
        fuse(stack(frame, frame), poses((0, 0, 0)), MODEL)
