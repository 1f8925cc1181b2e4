"""Records, a random model and a finished run, which several tests share."""

import contextlib
import functools
import io
from pathlib import Path
from typing import NamedTuple

import jax
import pytest

from experiments import build, main
from experiments.configs import default
from jradar.data import PrepareSpec, Records, prepare
from jradar.lidar import LidarSpec
from jradar.model import Model
from tests.experiments.tiny_config import shrink
from tests.models import random_params
from tests.recordings.small_sequence import write_sequence, write_splits

TINY = f"--config={Path(__file__).with_name('tiny_config.py')}"


@pytest.fixture(scope="package", autouse=True)
def compile_quickly():
    """Little of what is compiled here, or in child processes, runs often."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
        jax.config.update("jax_disable_most_optimizations", True)
        yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture(scope="package")
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


@pytest.fixture(scope="package")
def made(records):
    """A function from a config's module to its small config and a random model."""
    frames = Records(records, "train")

    @functools.cache
    def make(module):
        config = shrink(module.get_config())
        if config.method == "diffusion":
            config.noise.prediction = "edm"
        return config, random_model(config, frames)

    return make


def random_model(config, records: Records) -> Model:
    """A model of random parameters for a config."""
    spec = build.build_spec(config, records)
    shapes = spec.grid.image_shape, spec.grid.condition_shape
    params = random_params(spec.network, *shapes)
    return Model(params, spec, card=build.build_card(config, records))


class Run(NamedTuple):
    """A finished run, and what it printed."""

    workdir: Path
    flags: list[str]
    out: str


@pytest.fixture(scope="package")
def finished(records, tmp_path_factory):
    """A tiny run, from training to the report."""
    workdir = tmp_path_factory.mktemp("finished")
    flags = [TINY, f"--config.data.path={records}"]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main.main(["main", *flags, f"--workdir={workdir}"]) == 0
    return Run(workdir, flags, out.getvalue())
