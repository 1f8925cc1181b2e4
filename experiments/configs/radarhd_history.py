r"""RadarHD's real pairs with the radar images of the last two seconds, as in RadarHD.

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_history

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.model=radarhd-history \
        --config.nearness=radarhd-nearness

The last command also averages draws with the images of `radarhd-nearness`. Differs
from `radarhd` in two fields. `data.path` must hold every frame: in a packed file
of every fourth one, 41 images cover eight seconds.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.data.history = 41  # newest first, at 20 images a second
    config.answer = "diffusion"
    return config
