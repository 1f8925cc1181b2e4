r"""RadarHD's real pairs with the last radar images as channels of the condition.

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_history

For the whole public folder: RadarHD itself takes 41 images. Differs from `radarhd` in
one field.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.data.history = 41
    return config
