r"""Ablation: one range image as the condition, where near points hide far ones.

    python -m experiments.main --config=experiments/configs/ablation_one_slice.py \
        --config.data.path=RECORDS --workdir=runs/ablation_one_slice

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.27 m and 33.1 % (F-score at 0.2 m) against 1.16 m and 38.7 % of `default`; frame by
frame -5.6 points (-7.5 to -3.8) and 0.12 m (0.04 to 0.20).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.num_slices = 1
    return config
