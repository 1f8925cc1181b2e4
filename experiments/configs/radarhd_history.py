r"""RadarHD's real pairs in one pass, from the radar images of the last two seconds.

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_history

    python -m experiments.main --config=experiments/configs/radarhd_history.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.weights=experiments/results/radarhd_history.safetensors

`data.path` must hold every frame: in a packed file of every fourth one, the last 41
images cover eight seconds. Training takes an hour on one core.
"""

from experiments.configs import radarhd_nearness


def get_config():
    config = radarhd_nearness.get_config()
    config.data.history = 41  # at 20 images a second, as RadarHD
    config.train.steps = 4000
    return config
