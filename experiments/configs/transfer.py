r"""The main task, started from a prior instead of from random weights.

    python -m experiments.main --config=experiments/configs/transfer.py \
        --config.train.initial=runs/pretrain --workdir=runs/transfer

The run to compare it with is `default` for as many steps:

    python -m experiments.main --config=experiments/configs/default.py \
        --workdir=runs/scratch

`train.initial` also takes the workdir of another run of the main task, a bundle, or the
weights of a published model whose network the config has. Differs from `default` in
that it must be given. Not run to the end yet.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.purpose = "started from a prior, then trained on simulated scenes only"
    config.train.initial = ""
    return config
