r"""Ablation: Eq. 12 without the perceptual term.

    python -m experiments.main --config=experiments/configs/ablation_no_lpips.py \
        --config.data.path=RECORDS --workdir=runs/ablation_no_lpips

Differs from `paper_loss` in one field.
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.loss.perceptual = 0.0
    return config
