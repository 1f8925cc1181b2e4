r"""Ablation: square patches of as many pixels, in place of the horizontal stem.

    python -m experiments.main \
        --config=experiments/configs/ablation_no_horizontal_stem.py \
        --config.data.path=RECORDS --workdir=runs/ablation_no_horizontal_stem

The image's grid is then four times as wide as high, so that the condition has to be
cut into upright patches to meet it. Not run to the end yet.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.stem = (16, 16)
    config.network.condition_stem = (8, 2)
    return config
