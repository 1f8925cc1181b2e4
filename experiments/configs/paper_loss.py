r"""Eq. 12 whole: squared error, distance and LPIPS (extra `lpips`).

    python -m experiments.main --config=experiments/configs/paper_loss.py \
        --config.data.path=RECORDS --workdir=runs/paper_loss

The paper gives no weights: these are ours. Not run to the end yet.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.loss.update(squared=1.0, absolute=0.1, perceptual=0.1)
    return config
