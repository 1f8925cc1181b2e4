r"""Ablation: ranges coded linearly, not by their logarithm.

    python -m experiments.main --config=experiments/configs/ablation_linear_codec.py \
        --config.data.path=RECORDS --workdir=runs/ablation_linear_codec

Differs from `default` in one field.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.codec = "linear"
    return config
