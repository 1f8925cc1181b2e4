r"""The recipe of the shipped model: each pixel's distribution of range, in one pass.

    python -m experiments.main --config=experiments/configs/marginal.py \
        --workdir=runs/marginal

The network starts from the shipped model that draws samples, and learns the likelihood
of LiDAR images (`jradar.diffusion.mixture`). Every sequence has a radar unit of its own
(`jradar-sim-3`). Training takes 75 minutes on two busy CPU cores, after 15 minutes of
simulation and preparation.
"""

from experiments.configs import varied


def get_config():
    config = varied.get_config()
    config.method = "marginal"
    config.noise.prediction = "mixture"
    config.data.set = "jradar-sim-3"
    config.train.initial = "jradar-sim-diffusion"
    config.train.update(steps=4000, learning_rate=7e-4, warmup_steps=100, thin=0.3)
    config.train.update(checkpoint_every=200, evaluate_every=500, ema_decay=0.997)
    return config
