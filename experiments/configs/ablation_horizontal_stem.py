r"""Ablation: a horizontal stem as in the paper, patches four times as wide as high.

    python -m experiments.main \
        --config=experiments/configs/ablation_horizontal_stem.py \
        --config.data.path=RECORDS --workdir=runs/ablation_horizontal_stem

The paper's stem takes 128 x 512 pixels to a square grid. So does this one; its patches
have as many pixels as the square patches of `default`.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.stem = (8, 32)
    config.network.condition_stem = (4, 4)
    return config
