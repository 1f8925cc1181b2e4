r"""Ablation: the condition resized and concatenated with the noisy image.

    python -m experiments.main \
        --config=experiments/configs/ablation_condition_at_input.py \
        --config.data.path=RECORDS --workdir=runs/ablation_condition_at_input

In the paper the condition enters during downsampling, as in `default`. A step takes
nearly three times as long as a step of `default`.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.condition_at_input = True
    return config
