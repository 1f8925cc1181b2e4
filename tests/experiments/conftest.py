"""Records, a random model and a finished run, which several tests share."""

import contextlib
import io
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import build, main
from experiments.configs import default
from jradar.data import PrepareSpec, Records, prepare
from jradar.lidar import LidarSpec
from jradar.model import Model
from tests.recordings.small_sequence import write_sequence, write_splits

SMOKE = "--config=experiments/configs/smoke.py"
SMALL = [
    "--config.network.channels=8",
    "--config.evaluation.detectors=('os',)",
    "--config.train.batch_size=4",
    "--config.train.steps=12",
    "--config.train.checkpoint_every=4",
    "--config.sampling.steps=3",
]


@pytest.fixture(scope="session")
def records(tmp_path_factory):
    """Prepared frames of a small room, with the field of view of the configs."""
    source, folder = (tmp_path_factory.mktemp(name) for name in ("source", "records"))
    splits = {"a": "train", "b": "validation", "c": "test"}
    for seed, (name, frames) in enumerate({"a": 8, "b": 2, "c": 2}.items()):
        write_sequence(source, name, frames=frames, seed=seed)
    write_splits(source, splits)
    view = build.field_of_view(default.get_config().image)
    prepare(source, folder, PrepareSpec(lidar=LidarSpec(**view)), workers=1)
    return folder


def shrink(config):
    """Images and a network that compile in seconds."""
    config.image.update(coarse=(8, 8), fine=(16, 64))
    config.network.update(channels=8, multipliers=(1, 2), attention_levels=())
    config.network.update(stem=(2, 8), condition_stem=(1, 1))


def random_model(config, records: Records) -> Model:
    """A model of random parameters for a config."""
    spec = build.build_spec(config, records)
    pair = build.build_pairs(spec, records)[0]
    shapes = jax.eval_shape(
        spec.network.init,
        jax.random.key(0),
        jnp.zeros((1, *pair.lidar.shape, 2)),
        jnp.zeros(1),
        jnp.asarray(pair.condition[None]),
    )
    rng = np.random.default_rng(0)
    params = jax.tree.map(
        lambda leaf: 0.1 * rng.normal(size=leaf.shape).astype(np.float32), shapes
    )
    return Model(params, spec)


class Run(NamedTuple):
    """A finished run, and what it printed."""

    workdir: Path
    flags: list[str]
    out: str


@pytest.fixture(scope="session")
def finished(records, tmp_path_factory):
    """A small run of the smoke experiment, from training to the report."""
    workdir = tmp_path_factory.mktemp("finished")
    flags = [SMOKE, *SMALL, f"--config.data.path={records}"]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main.main(["main", *flags, f"--workdir={workdir}"]) == 0
    return Run(workdir, flags, out.getvalue())
