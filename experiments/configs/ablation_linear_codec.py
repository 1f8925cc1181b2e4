r"""Ablation: ranges coded linearly, not by their logarithm.

    python -m experiments.main --config=experiments/configs/ablation_linear_codec.py \
        --config.data.path=RECORDS --workdir=runs/ablation_linear_codec

2026-11-22, on 96 layouts of 20 frames, 550 steps of each, 48 validation frames, Heun 18
at 0.6: 1.03 m and 40.1 % (F-score at 0.2 m) against 1.07 m and 40.1 % of `default`;
frame by frame -0.0 points (-3.8 to 3.8) and -0.04 m (-0.15 to 0.07). The one-step
estimate falls behind, by 13.1 points (6.7 to 19.5).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.codec = "linear"
    return config
