r"""Eq. 12 whole: squared error, distance and LPIPS (extra `lpips`).

    python -m experiments.main --config=experiments/configs/paper_loss.py \
        --config.data.path=RECORDS --workdir=runs/paper_loss

The paper gives no weights: these are ours.

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.31 m and 39.1 % (F-score at 0.2 m) against 1.16 m and 38.7 % of `default`; frame by
frame +0.4 points (-0.7 to 1.4) and 0.15 m (0.08 to 0.23); the one-step estimate +3.8
points (2.7 to 4.8). LPIPS makes a step 3.4 times as long. What each term does:
`ablation_no_lpips`, `ablation_no_distance`.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.loss.update(squared=1.0, absolute=0.1, perceptual=0.1)
    return config
