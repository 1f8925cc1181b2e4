r"""RadarHD's real pairs by direct regression: `radarhd` with another training loss.

    python -m experiments.main --config=experiments/configs/radarhd_regression.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_regression

The network sees the condition alone, and is trained with squared error and Dice.

2026-11-21, 1,200 steps of 16 on one core, with a convolution for the head (linear now):
trajectories 138 and 140, Chamfer 0.584 m, MHD 0.392 m, F-score 58.8 % at 0.2 m.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.method = "regression"
    return config
