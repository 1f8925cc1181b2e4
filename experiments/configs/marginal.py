r"""The recipe of the shipped model: each pixel's distribution of range, in one pass.

    python -m experiments.main --config=experiments/configs/marginal.py \
        --workdir=runs/marginal

The network learns the likelihood of LiDAR images (`jradar.diffusion.mixture`). Every
sequence has a radar unit of its own (`jradar-sim-4`). The run trains the shipped model
on. The first one started from `jradar-sim-diffusion`, with 4,000 steps on
`jradar-sim-3`. 3,000 steps take 50 minutes on two busy CPU cores, after 25 minutes of
simulation and preparation.
"""

from experiments.configs import varied


def get_config():
    config = varied.get_config()
    config.method = "marginal"
    config.noise.prediction = "mixture"
    config.data.set = "jradar-sim-4"
    config.train.initial = "jradar-sim"
    config.train.update(steps=3000, learning_rate=6e-4, warmup_steps=100, thin=0.3)
    config.train.update(checkpoint_every=200, evaluate_every=500, ema_decay=0.997)
    return config
