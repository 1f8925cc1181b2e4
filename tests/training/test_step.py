"""The step: pure, its loss falls; the moving average against closed forms."""

import jax
import numpy as np
import pytest

from jradar.training import TrainState
from jradar.training.step import ema_decay_at
from tests.training import tiny
from tests.training.tiny import STEP

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def start():
    return tiny.new_state()


def test_step_is_pure_and_each_step_has_other_noise(start):
    batch = tiny.batch_at(0)
    once, again = STEP(start, KEY, batch), STEP(start, KEY, batch)
    jax.tree.map(np.testing.assert_array_equal, once, again)
    later = STEP(start._replace(step=start.step + 1), KEY, batch)
    assert later[1]["loss"] != once[1]["loss"]
    assert isinstance(start, TrainState) and int(once[0].step) == 1


def test_loss_falls(start):
    state, losses = start, []
    for _ in range(200):
        state, metrics = STEP(state, KEY, tiny.batch_at(0))
        losses.append(float(metrics["loss"]))
    assert np.mean(losses[-40:]) < 0.9 * np.mean(losses[:40])


def average(values, **options):
    """The moving average of a sequence, starting from a value far away."""
    mean = 1e6
    for step, value in enumerate(values):
        decay = float(ema_decay_at(step, **options))
        mean = decay * mean + (1 - decay) * value
    return mean


def test_warm_average_forgets_the_start_within_a_hundred_steps():
    # The product of k / (k + 9) for k = 1..n is n! 9! / (n + 9)!: about 1e-12 at 100.
    assert abs(average(np.zeros(100), decay=0.999)) < 1e-5
    np.testing.assert_allclose(ema_decay_at(10**6, decay=0.999), 0.999, rtol=1e-6)
