"""Invented pairs of RadarHD, and a network that compiles in seconds."""

import numpy as np
import pytest

from experiments.radarhd.model import build_spec
from jradar.model import Model
from jradar.model.grids.polar import LIDAR, RADAR
from tests.models import random_params


@pytest.fixture(scope="session")
def walls(tmp_path_factory):
    """A file of straight walls, also seen by the radar, at another distance each."""
    path = tmp_path_factory.mktemp("radarhd") / "pairs.npz"
    keys = [(number, frame) for number in (1, 136, 137, 138, 140) for frame in (0, 1)]
    rows = [60 + 20 * frame + number % 7 for number, frame in keys]
    lidar = np.arange(LIDAR.shape[0])[:, None] == np.array(rows)[:, None, None]
    near = abs(np.arange(RADAR.shape[0])[:, None] - np.array(rows)[:, None, None]) <= 1
    trajectory, frame = np.array(keys).T
    np.savez(
        path,
        radar=np.broadcast_to(200 * near, (10, *RADAR.shape)).astype(np.uint8),
        lidar_packed=np.packbits(np.broadcast_to(lidar, (10, *LIDAR.shape)), axis=-1),
        trajectory=trajectory,
        frame=frame,
    )
    return path


def shrink(config, path=""):
    """Make the network and the run of a config small, and name its pairs."""
    config.data.update(path=str(path), every=1)
    config.network.update(channels=8, multipliers=(1,), attention_levels=())
    config.network.update(condition_channels=8, stem=(16, 32), condition_stem=(16, 4))
    config.train.update(steps=3, batch_size=2, checkpoint_every=2, evaluate_every=2)
    config.train.warmup_steps = 1
    config.sampling.update(steps=2, draws=2, batch_size=2)
    config.confidence.update(turns=(0.0,), sizes=(0.7,))
    return config


def random_model(config, **scale):
    """A model of random parameters for a config."""
    spec = build_spec(config)
    shapes = spec.grid.image_shape, spec.grid.condition_shape
    return Model(random_params(spec.network, *shapes, **scale), spec)
