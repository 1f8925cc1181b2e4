r"""Ablation: a horizontal stem as the paper has it, patches four times as wide as high.

    python -m experiments.main \
        --config=experiments/configs/ablation_horizontal_stem.py \
        --config.data.path=RECORDS --workdir=runs/ablation_horizontal_stem

The paper's stem takes 128 x 512 pixels to a square grid; so does this one, with as many
pixels in a patch as the square patches of `default`. Not run to the end yet.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.stem = (8, 32)
    config.network.condition_stem = (4, 4)
    return config
