r"""The recipe of the shipped weights: a diffusion model started from direct regression.

    python -m experiments.main --config=experiments/configs/regression.py \
        --workdir=runs/first
    python -m experiments.main --config=experiments/configs/regression.py \
        --config.data.path=runs/first/data/records \
        --config.train.initial=runs/first --config.train.steps=5400 \
        --workdir=runs/regression
    python -m experiments.main --config=experiments/configs/finetune.py \
        --config.data.path=runs/first/data/records \
        --config.train.initial=runs/regression --workdir=runs/finetune

Regression learns faster what the radar says of a room; the diffusion model learns from
there what rooms look like. 2026-11-22, two CPU cores: 38 minutes, 77 beside other work,
and 20. A frame of each of 96 validation layouts: regression Chamfer 0.775 m, MHD 0.361
m, F-score 62.3 % at 0.2 m; from it 0.642 m, 0.249 m, 64.0 % at the temperature 0.4,
0.630 m and 63.3 % at 0.5.
"""

from experiments.configs import transfer


def get_config():
    config = transfer.get_config()
    config.purpose = "trained on simulated scenes only"
    config.train.update(steps=1200, learning_rate=5e-4, warmup_steps=50)
    config.train.ema_decay = 0.99
    config.train.update(checkpoint_every=150, evaluate_every=450)
    config.sampling.temperature = 0.4
    return config
