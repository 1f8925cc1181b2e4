r"""The diffusion model, trained on with a place of its own in every frame.

    python -m experiments.main --config=experiments/configs/varied.py \
        --workdir=runs/varied

Each frame has a place of its own (`jradar-sim-5`), and each eight frames a radar unit
of their own. Frames change in size and direction whenever they are drawn. The run
starts from `jradar-sim-diffusion`. `python -m experiments.studies.robustness` scores
the result under shifts that training never saw.
"""

from experiments.configs import from_regression


def get_config():
    config = from_regression.get_config()
    config.data.set = "jradar-sim-5"
    config.points.remove_interference = True
    config.train.initial = "jradar-sim-diffusion"
    config.train.update(steps=3000, learning_rate=6e-4, warmup_steps=100)
    config.train.update(checkpoint_every=200, evaluate_every=500, ema_decay=0.997)
    config.augment.update(thin=0.3, scale=(0.7, 1.5), rotation_deg=15.0)
    config.augment.update(alone=0.08, perfect=0.05)
    return config
