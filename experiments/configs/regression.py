r"""Baseline: the same network trained by direct regression, with the squared error.

    python -m experiments.main --config=experiments/configs/regression.py \
        --workdir=runs/regression

Its row in the tables is `direct regression`. Training takes an hour on two cores, after
the simulation. `from_regression` starts from this model.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.method = "regression"
    config.noise.prediction = "clean"
    config.train.steps = 14400  # 50 epochs
    config.purpose = "direct regression, a baseline: no diffusion model to sample from"
    return config
