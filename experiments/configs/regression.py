r"""Baseline: the same network trained to answer at once, by squared error.

    python -m experiments.main --config=experiments/configs/regression.py \
        --config.data.path=RECORDS --workdir=runs/regression

Its row is `direct regression`. 38 minutes on two cores; twice is better than once,
see `finetune`, which starts from it and has its scores.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.method = "regression"
    config.noise.prediction = "clean"
    config.purpose = "direct regression, a baseline: no diffusion model to sample from"
    return config
