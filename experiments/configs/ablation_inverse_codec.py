r"""Ablation: ranges coded by their inverse, not by their logarithm.

    python -m experiments.main --config=experiments/configs/ablation_inverse_codec.py \
        --config.data.path=RECORDS --workdir=runs/ablation_inverse_codec

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.10 m and 37.7 % (F-score at 0.2 m) against 1.16 m and 38.7 % of `default`; frame by
frame -1.0 points (-2.5 to 0.5) and -0.06 m (-0.12 to 0.01).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.codec = "inverse"
    return config
