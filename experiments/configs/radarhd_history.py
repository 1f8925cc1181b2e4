r"""RadarHD's real pairs with 41 radar images in a condition, as in RadarHD.

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_history

It needs the whole public folder. Differs from `radarhd` in one field.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.data.history = 41
    return config
