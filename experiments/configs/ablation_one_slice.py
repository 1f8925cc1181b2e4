r"""Ablation: one range image as the condition, where near points hide far ones.

    python -m experiments.main --config=experiments/configs/ablation_one_slice.py \
        --config.data.path=RECORDS --workdir=runs/ablation_one_slice

2026-11-22, on 96 layouts of 20 frames, 550 steps of each, 48 validation frames, Heun 18
at 0.6: 1.19 m and 32.3 % (F-score at 0.2 m) against 1.07 m and 40.1 % of `default`;
frame by frame -7.8 points (-11.2 to -4.4) and 0.12 m (-0.05 to 0.29).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.image.num_slices = 1
    return config
