r"""The main task, started from a prior instead of random weights.

    python -m experiments.main --config=experiments/configs/transfer.py \
        --config.train.initial=runs/pretrain --workdir=runs/transfer

Compare it with `default`, trained for as many steps. `train.initial` is the workdir of
`pretrain` or of another run of the main task, a model, or a published file of weights
for the config's network.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.purpose = "started from a prior, then trained on simulated scenes only"
    config.train.initial = ""
    return config
