r"""Ablation: Eq. 12 without the distance term.

    python -m experiments.main --config=experiments/configs/ablation_no_distance.py \
        --config.data.path=RECORDS --workdir=runs/ablation_no_distance

Differs from `paper_loss` in one field.
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.loss.absolute = 0.0
    return config
