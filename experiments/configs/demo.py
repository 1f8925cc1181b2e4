r"""The demonstration: detectors and shipped models on simulated rooms, new to all.

    python -m experiments.main --config=experiments/configs/demo.py \
        --workdir=runs/demo

Simulates one frame of three layouts of each scene family, each with a radar unit of its
own, and scores the CFAR detectors and the models that the package ships. Nothing is
trained. The false-alarm rates are those of the best F-scores on a validation split.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.task = "demo"
    config.purpose = "a demonstration: nothing is trained"
    config.data.set = "jradar-sim-4-test"
    config.data.frames = 1  # per layout
    config.data.layouts = 3  # per family, of the 192 in the test split
    config.evaluation.every = 1
    config.evaluation.rates = {"so": 1e-3, "ca": 1e-2, "go": 1e-2, "os": 1e-3}
    return config
