r"""Baseline: the same network trained to answer at once, by squared error.

    python -m experiments.main --config=experiments/configs/regression.py \
        --workdir=runs/regression

Its row is `direct regression`. 61 minutes on two cores, after the simulation; see
`finetune`, which starts from it and has its scores.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.method = "regression"
    config.noise.prediction = "clean"
    config.train.steps = 14400  # 50 times through the training set
    config.purpose = "direct regression, a baseline: no diffusion model to sample from"
    return config
