r"""All terms of Eq. 12: squared error, distance and LPIPS (needs the extra `lpips`).

    python -m experiments.main --config=experiments/configs/paper_loss.py \
        --config.data.path=RECORDS --workdir=runs/paper_loss

The paper does not publish the weights of the terms; these are our choice. Training
takes over three times as long as `default`.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.loss.update(squared=1.0, absolute=0.1, perceptual=0.1)
    return config
