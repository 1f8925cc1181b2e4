r"""RadarHD's real pairs by direct regression: `radarhd` with another training loss.

    python -m experiments.main --config=experiments/configs/radarhd_regression.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_regression

The network sees the condition alone, and is trained with the squared error and Dice.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.method = "regression"
    return config
