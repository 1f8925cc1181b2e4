r"""A prior from photographs for the main task: the same network, without a condition.

    python -m experiments.main --config=experiments/configs/pretrain.py \
        --config.data.path=PHOTOGRAPHS --workdir=runs/pretrain

`data.path` is a folder of JPEG, PNG or WebP files. The workdir's `prior.safetensors`
is what `transfer` starts from; it is written anew at every evaluation. Network, noise
levels and image are the main task's: a prior is of no use with others.

2026-11-22, 550 steps on 33 photographs, 10 minutes on one core: at the noise 0.2, 0.8
and 3.2 the error of photographs kept apart is 0.100, 0.098 and 0.131, that of the mean
photograph 0.424. What it is good for: see `transfer`.
"""

from ml_collections import ConfigDict

from experiments.configs import default


def get_config():
    main = default.get_config()
    config = ConfigDict()
    config.task = "pretrain"
    config.seed = 0

    config.data = ConfigDict()
    config.data.path = ""
    config.data.validation = 8  # of so many photographs one is kept apart

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
