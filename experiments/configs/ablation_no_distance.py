r"""Ablation: Eq. 12 without the distance term. `paper_loss` with one weight less.

    python -m experiments.main --config=experiments/configs/ablation_no_distance.py \
        --config.data.path=RECORDS --workdir=runs/ablation_no_distance

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.17 m and 39.8 % (F-score at 0.2 m) against 1.31 m and 39.1 % of `paper_loss`; frame by
frame +0.7 points (-0.1 to 1.4) and -0.13 m (-0.20 to -0.06). Against `default`, which
is without LPIPS too, +1.0 points (-0.1 to 2.2) and 0.02 m (-0.02 to 0.06); the one-step
estimate +5.1 points (3.9 to 6.2) and -0.08 m (-0.12 to -0.05).
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.loss.absolute = 0.0
    return config
