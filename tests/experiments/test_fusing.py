"""Fusing frames of records: the library's fusion, by the recorded poses."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import build, enhance, fusing
from experiments.configs import default, marginal
from experiments.evaluate import Frame
from jradar import data, session
from jradar.errors import UsageError
from jradar.model import draw, fuse

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def given(records, made):
    """A random model of one pass, frames that follow each other, and their images."""
    _, model = made(marginal)
    all_points = model.confidence._replace(least=np.float32(0.0))
    model = dataclasses.replace(model, confidence=all_points)
    frames = data.Records(records, "train")
    return model, frames, build.build_pairs(model.spec, frames)


def test_frames_are_laid_into_the_newest_by_their_poses(given):
    model, frames, pairs = given
    number = [frame for _, frame in frames.where].index(4)
    method = fusing.fused_method(model, frames, pairs, 3)
    cloud = method(KEY, Frame(frames[number], pairs[number]))
    some = [number, number - 1, number - 2]
    radar = frames.radar_of(frames[number].sequence)
    seen = [
        session.see(frames[i].radar, pairs[i].condition, model, radar) for i in some
    ]
    poses = [frames[i].world_from_radar for i in some]
    stacked = jax.tree.map(lambda *values: jnp.stack(values), *seen)
    expected = fuse(
        stacked.mixture,
        jnp.asarray(np.linalg.solve(poses[0], poses), jnp.float32),
        model,
        moving=stacked.moving,
    )
    assert np.asarray(cloud.valid).any()
    np.testing.assert_allclose(
        np.linalg.norm(cloud.xyz, axis=-1), expected.range_m.ravel(), atol=1e-4
    )
    np.testing.assert_allclose(cloud.confidence, expected.confidence.ravel(), atol=1e-4)


def test_frames_without_earlier_ones_or_poses_stand_alone(given):
    model, frames, pairs = given
    alone = draw(KEY, pairs[0].condition, model)

    def is_alone(cloud):
        hit = np.asarray(alone.range_m).ravel() > 0
        np.testing.assert_allclose(
            cloud.confidence, alone.confidence.ravel(), atol=1e-3
        )
        assert (np.asarray(cloud.valid) == hit).mean() > 0.99

    is_alone(
        fusing.fused_method(model, frames, pairs, 3)(KEY, Frame(frames[0], pairs[0]))
    )
    nowhere = np.full((4, 4), np.nan)
    poses = fusing.relative_poses([nowhere, np.eye(4)])
    np.testing.assert_array_equal(poses[0], np.eye(4))
    assert np.isnan(poses[1]).all()


def test_other_methods_and_numbers_are_refused():
    for config, count in ((default.get_config(), 3), (marginal.get_config(), 0)):
        config.train.initial = None
        config.evaluation.fuse = count
        with pytest.raises(UsageError, match=f"evaluation.fuse = {count} with the"):
            enhance.check(config)
