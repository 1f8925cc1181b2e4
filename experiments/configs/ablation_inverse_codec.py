r"""Ablation: ranges coded by their inverse, not their logarithm.

    python -m experiments.main --config=experiments/configs/ablation_inverse_codec.py \
        --config.data.path=RECORDS --workdir=runs/ablation_inverse_codec

Differs from `default` in one field.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.codec = "inverse"
    return config
