r"""The demonstration: methods side by side on invented rooms that none was trained on.

    python -m experiments.main --config=experiments/configs/demo.py \
        --workdir=runs/demo

A frame of three layouts of each scene family is simulated, and goes through the CFAR
detectors and the weights that the package ships. Nothing is trained. Detectors have
the rates that `experiments.studies.detectors` chose on the validation split of the
simulated set (48 frames of its 12 layouts, 2026-11-21).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.task = "demo"
    config.purpose = ""
    config.data.set = "jradar-sim-test"
    config.data.frames = 1  # of each layout
    config.data.layouts = 3  # of each family, of the set's test split; it has 192
    config.evaluation.every = 1
    config.evaluation.rates = {"so": 1e-3, "ca": 1e-2, "go": 1e-2, "os": 1e-3}
    return config
