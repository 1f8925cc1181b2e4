r"""The paper's network on simulated ColoRadar scenes; for a GPU.

    python -m experiments.main --config=experiments/configs/paper.py \
        --workdir=runs/paper

The trunk of EDM's FFHQ network, a horizontal stem, and Eq. 12. It has not been run to
the end yet.
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.network = {"preset": "paper", "dtype": "bfloat16", "remat": True}
    config.train.update(steps=100_000, batch_size=32, learning_rate=2e-4)
    config.train.ema_decay = 0.9999
    return config
