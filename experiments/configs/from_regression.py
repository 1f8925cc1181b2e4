r"""A diffusion model that starts from direct regression.

    python -m experiments.main --config=experiments/configs/regression.py \
        --workdir=runs/regression
    python -m experiments.main --config=experiments/configs/from_regression.py \
        --config.data.path=runs/regression/data/records \
        --config.train.initial=runs/regression --workdir=runs/from_regression

Regression learns faster where the surfaces are; the diffusion model then learns what
rooms look like. The two take 61 and 6 minutes on two CPU cores.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.train.initial = ""
    config.train.update(steps=1200, learning_rate=5e-4, warmup_steps=50)
    config.train.ema_decay = 0.99
    config.train.update(checkpoint_every=150, evaluate_every=450)
    config.sampling.temperature = 0.4
    return config
