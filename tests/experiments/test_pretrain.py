"""The prior: batches by step, a run that ends with it, and the main task's start."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax.traverse_util import flatten_dict
from PIL import Image

from experiments import build, train as skeleton, weights
from experiments.configs import default, pretrain as pretrain_config, transfer
from experiments.tasks import pretrain
from jradar import training
from jradar.errors import ModelError, UsageError
from tests.diffusion.networks import random_params


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Natural-like images: noise whose amplitude falls with its frequency."""
    folder, rng = tmp_path_factory.mktemp("photographs"), np.random.default_rng(0)
    frequency = np.hypot(np.fft.fftfreq(48)[:, None], np.fft.rfftfreq(96))
    frequency[0, 0] = 1
    for name in "abcd":
        noise = np.fft.rfft2(rng.normal(size=(48, 96))) / frequency
        image = np.fft.irfft2(noise)
        grey = 127 + 50 * (image - image.mean()) / image.std()
        Image.fromarray(np.clip(grey, 0, 255).astype(np.uint8)).save(
            folder / f"{name}.png"
        )
    return folder


@pytest.fixture(autouse=True)
def compile_quickly():
    """Little of what is compiled here runs more than once."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture
def config(photographs):
    config = pretrain_config.get_config()
    config.data.update(path=str(photographs), validation=4)
    config.image.update(coarse=(4, 4), fine=(8, 32))
    config.network.update(channels=4, multipliers=(1,), attention_levels=(), blocks=0)
    config.network.update(stem=(2, 8), condition_stem=(1, 1))
    config.train.update(steps=4, batch_size=3, checkpoint_every=2, evaluate_every=2)
    config.train.warmup_steps = 1
    config.sampling.steps = 2
    return config


def test_batches_are_functions_of_seed_and_step(config):
    photographs, chosen, kept = pretrain.open_photographs(config)
    assert (chosen, [*kept]) == ([1, 2, 3], [0])

    def batch(step):
        return pretrain.batch_at(config, photographs, chosen, step)

    first = batch(5)
    assert first.target.shape == (3, 8, 32, 2) and first.condition.shape == (3, 4, 4, 1)
    assert (first.target[..., 1] == 1).all() and not first.condition.any()
    assert np.abs(first.target).max() <= 1 and first.target[..., 0].std() > 0.1
    jax.tree.map(np.testing.assert_array_equal, batch(5), first)
    assert not np.array_equal(batch(6).target, first.target)
    config.seed = 1
    assert not np.array_equal(batch(5).target, first.target)


def test_photographs_must_be_named_and_enough(config):
    config.data.validation = 5
    with pytest.raises(UsageError, match="5 of 4 photographs: expected 2 to 4"):
        pretrain.open_photographs(config)
    config.data.path = ""
    with pytest.raises(UsageError, match="a folder of them as --config.data.path"):
        pretrain.check(config)


def main_state(network):
    """The main task's state before its first step, on images of another size."""
    image, condition = jnp.zeros((1, 4, 16, 2)), jnp.zeros((1, 2, 2, 6))
    params = random_params(network, image, jnp.zeros(1), condition)
    optimizer = build.build_optimizer(default.get_config().train)
    return training.TrainState(jnp.int32(0), params, params, optimizer.init(params))


def test_a_run_ends_with_a_prior_that_starts_the_main_task(config, tmp_path, capsys):
    with pytest.raises(ModelError, match="no prior at"):
        pretrain.evaluate(config, tmp_path)
    skeleton.run(pretrain, config, tmp_path)
    assert (tmp_path / "model_card.json").is_file()
    table = (tmp_path / "evaluation" / "table.md").read_text()
    assert table in capsys.readouterr().out and "| 0.05 |" in table
    assert (tmp_path / "evaluation" / "samples.png").stat().st_size > 5000

    network = build.build_network(config)
    train = transfer.get_config().train
    train.initial = str(tmp_path)
    scratch = main_state(network)
    state = weights.start_from(train, network, scratch)
    err = capsys.readouterr().err
    before, after = (
        flatten_dict(params["params"], sep="/")
        for params in (scratch.params, state.ema_params)
    )
    towers = [name for name in before if name.startswith("tower/")]
    trunk = [name for name in before if name.startswith("trunk/")]
    assert f"{len(trunk)} parameters loaded, {len(towers)} new ['params/tower']" in err
    assert state.params is state.ema_params
    for name in towers:
        np.testing.assert_array_equal(before[name], after[name])
    changed = [n for n in trunk if not np.array_equal(before[n], after[n])]
    assert {"trunk/stem/kernel", "trunk/unfold/kernel"} <= {*changed}
    conditions = [n for n in trunk if n.endswith("_condition/kernel")]
    assert conditions and not any(after[name].any() for name in conditions)


def test_weights_to_start_from_are_found_or_missed_before_anything_else(tmp_path):
    train = transfer.get_config().train
    with pytest.raises(UsageError, match="--config.train.initial=PATH"):
        weights.initial_weights(train)
    train.initial = str(tmp_path)
    with pytest.raises(UsageError, match=r"no weights at .*prior.safetensors"):
        weights.initial_weights(train)
    (tmp_path / "model").mkdir()
    file = tmp_path / "model" / "weights.safetensors"
    file.write_bytes(b"")
    for name in (tmp_path, tmp_path / "model", file):
        train.initial = str(name)
        assert weights.initial_weights(train) == file
    assert weights.initial_weights(default.get_config().train) is None
