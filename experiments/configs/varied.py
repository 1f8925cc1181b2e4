r"""A trained model, trained on with a radar unit of its own for every sequence.

    python -m experiments.main --config=experiments/configs/varied.py \
        --config.train.initial=runs/finetune --workdir=runs/varied

Boards, calibrations, mounts, speeds, clutter and interference differ from sequence to
sequence (`jradar-sim-2`). `python -m experiments.studies.robustness` scores the result
under shifts that training never saw.
"""

from experiments.configs import finetune


def get_config():
    config = finetune.get_config()
    config.data.set = "jradar-sim-2"
    config.points.remove_interference = True
    config.train.update(steps=6000, learning_rate=7e-4, warmup_steps=100)
    config.train.update(checkpoint_every=250, evaluate_every=1000, ema_decay=0.995)
    return config
