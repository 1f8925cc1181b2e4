r"""Ablation: a horizontal stem as the paper has it, patches four times as wide as high.

    python -m experiments.main \
        --config=experiments/configs/ablation_horizontal_stem.py \
        --config.data.path=RECORDS --workdir=runs/ablation_horizontal_stem

The paper's stem takes 128 x 512 pixels to a square grid; so does this one, with as many
pixels in a patch as the square patches of `default`.

2026-11-22, 550 steps of each, a frame of each of 96 validation layouts, Heun 18 at 0.6:
1.19 m and 36.4 % (F-score at 0.2 m) against 1.16 m and 38.7 % of `default`; frame by
frame -2.4 points (-4.0 to -0.7) and 0.04 m (-0.04 to 0.11).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.stem = (8, 32)
    config.network.condition_stem = (4, 4)
    return config
