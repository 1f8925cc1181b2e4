r"""A prior from photographs for the main task: the same network, without a condition.

    python -m experiments.main --config=experiments/configs/pretrain.py \
        --config.data.path=PHOTOGRAPHS --workdir=runs/pretrain

`data.path` is a folder of JPEG, PNG or WebP files. The result is `prior.safetensors` in
the workdir, from which `transfer` starts. Network, noise levels and image size are the
main task's, because a prior only fits these. Training takes an hour on one core.
"""

from ml_collections import ConfigDict

from experiments.configs import default


def get_config():
    main = default.get_config()
    config = ConfigDict()
    config.task = "pretrain"
    config.purpose = "a prior from photographs"
    config.seed = 0

    config.data = ConfigDict()
    config.data.path = ""
    config.data.validation = 8  # every eighth photograph is for validation

    config.image = ConfigDict()
    config.image.coarse = main.image.coarse  # of the condition, which is empty
    config.image.fine = main.image.fine
    config.noise = main.noise
    config.network = main.network

    config.train = main.train
    config.train.evaluate_every = 1000

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    return config
