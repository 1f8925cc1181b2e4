r"""Ablation: one range image as the condition, in which near points hide far ones.

    python -m experiments.main --config=experiments/configs/ablation_one_slice.py \
        --config.data.path=RECORDS --workdir=runs/ablation_one_slice

Differs from `default` in one field.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.num_slices = 1
    return config
