r"""Ablation: a horizontal stem as the paper has it, patches four times as wide as high.

    python -m experiments.main \
        --config=experiments/configs/ablation_horizontal_stem.py \
        --config.data.path=RECORDS --workdir=runs/ablation_horizontal_stem

The paper's stem takes 128 x 512 pixels to a square grid; so does this one, with as many
pixels in a patch as the square patches of `default`.

2026-11-22, on 96 layouts of 20 frames, 550 steps of each, 48 validation frames, Heun 18
at 0.6: 1.17 m and 36.6 % (F-score at 0.2 m) against 1.07 m and 40.1 % of `default`;
frame by frame -3.4 points (-5.5 to -1.4) and 0.10 m (-0.01 to 0.21).
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.stem = (8, 32)
    config.network.condition_stem = (4, 4)
    return config
