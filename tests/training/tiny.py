"""A run that compiles in a second, and a program of it that tests can kill.

python -m tests.training.tiny WORKDIR STEPS [--seconds=S]
"""

import argparse
import functools
import sys
import time
from pathlib import Path

import flax.linen as nn
import jax
import numpy as np
import optax

from jradar import training
from jradar.diffusion import NoiseSpec
from jradar.training.loop import Interrupted
from jradar.training.parallel import join_processes

KEY_SEED = 3
NOISE = NoiseSpec()
OPTIMIZER = optax.chain(optax.clip_by_global_norm(1.0), optax.adam(3e-3))


class TinyNet(nn.Module):
    """Three small convolutions with the interface of a network."""

    def setup(self):
        """One layer each for the condition, the image and both."""
        self.condition, self.image = nn.Conv(8, (1, 1)), nn.Conv(8, (3, 3))
        self.output = nn.Conv(2, (3, 3))

    def __call__(self, x, c_noise, condition):
        """Encode and decode."""
        return self.decode(x, c_noise, self.encode(condition))

    def encode(self, condition):
        """Features at the image's size."""
        return self.condition(condition).repeat(2, 2)

    def decode(self, x, c_noise, features):
        """Both, and the noise level."""
        level = c_noise[:, None, None, None]
        return self.output(nn.silu(self.image(x) + features + level))


NETWORK = TinyNet()
STEP = training.make_train_step(NETWORK, OPTIMIZER, NOISE, ema_decay=0.9)


def batch_at(step):
    rng = np.random.default_rng(step)
    return training.Batch(
        rng.normal(size=(4, 8, 8, 2)).astype(np.float32),
        0.5 * rng.normal(size=(4, 8, 16, 2)).astype(np.float32),
    )


def new_state():
    shapes = {"image_shape": (8, 16, 2), "condition_shape": (8, 8, 2)}
    key = jax.random.key(0, impl="rbg")
    return training.create_state(key, NETWORK, OPTIMIZER, **shapes)


def distance_from_zero(state, step):
    """Return a validation value that costs little."""
    leaves = map(np.asarray, jax.tree.leaves(state.ema_params))
    return {"loss": float(sum(np.square(leaf).sum() for leaf in leaves))}


def run(workdir, steps, *, before_step=lambda step: None):
    """Train until `steps`, and call `before_step` with the number of each step."""
    workdir.mkdir(exist_ok=True, parents=True)

    def next_batch_at(step):
        before_step(step)
        return batch_at(step)

    often = {"checkpoint_every": 2, "evaluate_every": 3, "evaluate": distance_from_zero}
    training.train(
        *(jax.random.key(KEY_SEED), new_state(), STEP, next_batch_at),
        **often | {"steps": steps, "workdir": workdir},
    )


def main():
    """Train, slowly enough to be disturbed. An interrupted run returns its code."""
    parser = argparse.ArgumentParser()
    parser.add_argument("workdir")
    parser.add_argument("steps", type=int)
    parser.add_argument("--seconds", type=float, default=0.0, help="before each step")
    options = parser.parse_args()
    sys.modules["tensorboardX"] = None  # it imports PyTorch if that is installed
    # A partner counts as dead after 20 s of silence, not after JAX's 100 s.
    soon = functools.partial(jax.distributed.initialize, heartbeat_timeout_seconds=20)
    jax.distributed.initialize = soon
    join_processes()
    try:
        workdir, seconds = Path(options.workdir), options.seconds
        run(workdir, options.steps, before_step=lambda step: time.sleep(seconds))
    except Interrupted as stop:
        print(stop, file=sys.stderr)
        return stop.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
