r"""The recipe of the shipped model: each pixel's distribution of range, in one pass.

    python -m experiments.main --config=experiments/configs/marginal.py \
        --workdir=runs/marginal

The network learns the likelihood of LiDAR images (`jradar.diffusion.mixture`). Some
components lie where the radar's points are (`jradar.diffusion.evidence`). Each frame
has a place of its own (`jradar-sim-5`), and changes in size and direction whenever it
is drawn. The run trains the shipped model on.
"""

from experiments.configs import varied


def get_config():
    config = varied.get_config()
    config.method = "marginal"
    config.noise.prediction = "mixture"
    config.data.set = "jradar-sim-5"
    config.network.kind = "evidence"
    config.train.initial = "jradar-sim"
    config.train.update(steps=3000, learning_rate=6e-4, warmup_steps=100)
    config.train.update(checkpoint_every=200, evaluate_every=500, ema_decay=0.997)
    config.augment.update(thin=0.3, scale=(0.7, 1.5), turn_deg=15.0)
    config.augment.update(alone=0.05, perfect=0.05)
    return config
