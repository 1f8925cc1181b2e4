r"""Ablation: ranges coded linearly, not by their logarithm.

    python -m experiments.main --config=experiments/configs/ablation_linear_codec.py \
        --config.data.path=RECORDS --workdir=runs/ablation_linear_codec

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.24 m and 36.3 % (F-score at 0.2 m) against 1.16 m and 38.7 % of `default`; frame by
frame -2.4 points (-3.9 to -1.0) and 0.09 m (-0.02 to 0.19); the one-step estimate -5.5
points (-7.6 to -3.5).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.codec = "linear"
    return config
