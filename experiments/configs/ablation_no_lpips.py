r"""Ablation: Eq. 12 without the perceptual term. `paper_loss` with one weight less.

    python -m experiments.main --config=experiments/configs/ablation_no_lpips.py \
        --config.data.path=RECORDS --workdir=runs/ablation_no_lpips

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.18 m and 38.4 % (F-score at 0.2 m) against 1.31 m and 39.1 % of `paper_loss`; frame by
frame -0.7 points (-1.7 to 0.4) and -0.12 m (-0.20 to -0.05); the one-step estimate -4.5
points (-5.7 to -3.4). Against `default`, which is without the distance term too, the
samples do not differ (-0.3 points, -1.1 to 0.5; 0.03 m, -0.01 to 0.07).
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.loss.perceptual = 0.0
    return config
